"""C99 of LLVM IR: against what numba and LLVM themselves make of the same functions, to the last bit."""

import ctypes
import subprocess

import llvmlite.binding as llvm
import numpy as np
import pytest

from flexmbd.errors import ExportError
from flexmbd.export.kernel_sources.c_module import HEADER, c_source, header
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.base.object_code import kernel_for

WHOLE = np.array([0, 1, 2, 3, 7, -1, -2, -7, 63, 64, 2**31, -(2**31), 2**32, 2**63 - 1, -(2**63), 2**62 + 5], np.int64)
REAL = np.array([0.0, -0.0, 1.0, -1.5, 2.5, 1e300, -1e-310, np.inf, -np.inf, np.nan, 3e9, -7.25], float)
OPTIONS = ["-std=c99", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fPIC", "-shared"]


def numbers(values, scale, count=60, seed=3):
    random = np.random.default_rng(seed)
    if values is WHOLE:
        return np.r_[values, random.integers(-scale, scale, count)]
    return np.r_[values, random.normal(size=count) * scale]


def library(texts, folder, optimise="-O2"):
    """The C texts compiled together."""
    (folder / HEADER).write_bytes(header())
    for k, text in enumerate(texts):
        (folder / f"c{k}.c").write_text(text)
    names = [f"c{k}.c" for k in range(len(texts))]
    sanitised = ["-fsanitize=undefined", "-fno-sanitize-recover"] if optimise == "-O1" else []
    subprocess.run(["gcc", *OPTIONS, optimise, *sanitised, *names, "-o", "c.so", "-lm"], cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "c.so"))


@entry_kernel
def whole_numbers(a, b, c):
    """What wraps around, divides with signs, shifts; a loop of swaps, and choices."""
    divisor = b if b != 0 else 3
    low, high = np.uint64(a), np.uint64(b)
    x, y, turns = a, b, 0
    for _ in range(abs(c) % 7):
        x, y, turns = y, x + 3 * turns, turns + 1
    choice = 0
    k = a % 9
    if k == 0:
        choice = b
    elif k == 1:
        choice = a ^ b
    elif k == 2:
        choice = -5
    elif k == 4:
        choice = a & 12345
    elif k == 5:
        choice = 77
    small, half = np.int8(a), np.int32(b)
    truth = ((a < b) ^ (low < high)) | (b == c)
    return (
        a + b, a * b, a - c, a // divisor, a % divisor, a << (b & 63), a >> (c & 63), low >> np.uint64(c & 63), x, y,
        choice, np.int64(small) * 3, np.int64(half * np.int32(3)), truth, abs(a), min(a, b, c), max(low, high),
    )  # fmt: skip


@entry_kernel
def real_numbers(x, y, z):
    """Comparisons, among them those with NaN, conversions and sums."""
    orders = 0
    for k, one in enumerate((x < y, x <= y, x == y, x != y, not x < y, not x >= y, x > y, not x == y)):
        orders |= int(one) << k
    within = x if abs(x) < 1e15 else 0.25
    single = np.float32(y) * np.float32(1.1) if abs(y) < 1e30 else np.float32(2.0)
    total = 0.0
    for k in range(5):
        total += (x * k + y) * z
    return (
        orders, x + y * z, x / (y if y != 0.0 else 1.5), int(within), np.int32(within * 1e-8), float(int(within)),
        np.float64(single), total, -x, abs(y), np.copysign(x, z), np.sqrt(abs(y)), np.floor(within), min(x, z), x % 3.0,
    )  # fmt: skip


@entry_kernel
def without_heap(x, y, z):
    """A table on the stack, of which numba keeps a part as a global, and a call of a mathematical function."""
    table = (1.5, 2.5, -3.5, 8.0)
    k = int(abs(x)) & 3 if abs(x) < 1e15 else 2
    return table[k], np.sin(y), np.arctan2(x, z), k


def results_of(function, inputs, folder, optimise):
    """What the C of a function returns, and what numba does, as numbers' bytes."""
    kernel = kernel_for(function, inputs[0])
    loaded = library([c_source(kernel.program, kernel.symbol, "kernel")], folder, optimise)
    kinds = [ctypes.c_int64 if isinstance(one, int) else ctypes.c_double for one in inputs[0]]
    loaded.kernel.argtypes = [ctypes.c_void_p, ctypes.c_void_p, *kinds]
    expected = [function(*one) for one in inputs]
    c_types = {bool: ctypes.c_uint8, int: ctypes.c_int64, float: ctypes.c_double}
    fields = [(f"e{k}", c_types[type(one)]) for k, one in enumerate(expected[0])]
    result = type("Result", (ctypes.Structure,), {"_fields_": fields})
    for given, wanted in zip(inputs, expected, strict=True):
        found, raised = result(), ctypes.c_void_p()
        assert loaded.kernel(ctypes.addressof(found), ctypes.addressof(raised), *given) == 0
        values = [getattr(found, name) for name, _ in fields]
        yield given, np.array(values, object), np.array(wanted, object)


def same(a, b):
    """Equal numbers with equal signs, or both none."""
    return all(
        (x != x and y != y) or (x == y and np.copysign(1.0, x) == np.copysign(1.0, y))
        for x, y in zip(a, b, strict=True)
    )


@pytest.mark.parametrize("optimise", ["-O1", "-O2"])
def test_whole_numbers_are_those_of_numba(tmp_path, optimise):
    a, b, c = (numbers(WHOLE, 2**62, seed=seed) for seed in range(3))
    inputs = [tuple(map(int, one)) for one in zip(a, np.roll(b, 5), np.roll(c, 11), strict=True)]
    inputs = [one for one in inputs if one[0] != -(2**63) or one[1] != -1]  # a quotient that numba leaves open
    for given, found, wanted in results_of(whole_numbers, inputs, tmp_path, optimise):
        assert [int(x) % 2**64 for x in found] == [int(x) % 2**64 for x in wanted], given


@pytest.mark.parametrize("optimise", ["-O1", "-O2"])
def test_real_numbers_are_those_of_numba(tmp_path, optimise):
    x, y, z = (numbers(REAL, 1e3, seed=seed) for seed in range(3))
    inputs = [tuple(map(float, one)) for one in zip(x, np.roll(y, 5), np.roll(z, 11), strict=True)]
    inputs += [(p, q, 1.0) for p in REAL.tolist() for q in REAL.tolist()]
    for function in (real_numbers, without_heap):
        folder = tmp_path / function.__name__
        folder.mkdir()
        for given, found, wanted in results_of(function, inputs, folder, optimise):
            assert same(found, wanted), (given, found, wanted)


def module_of(operations):
    """IR of a function that puts results of operations on %a, %b (i64) and %x, %y (double) into 8 bytes each."""
    lines, intrinsics = [], []
    for k, (kind, text) in enumerate(operations):
        width = int(kind.strip("i")) if kind[0] == "i" else 64
        names = {"a": "%a", "b": "%b"}
        if kind[0] == "i" and width != 64:
            lines += [f"%a{k} = trunc i64 %a to {kind}", f"%b{k} = trunc i64 %b to {kind}"]
            names = {"a": f"%a{k}", "b": f"%b{k}"}
        for part in text.format(**names, x="%x", y="%y", k=f"k{k}").split(";"):
            lines.append(part.strip().replace("%r ", f"%r{k} ").replace("%r,", f"%r{k},"))
        if kind[0] == "i" and width != 64:
            lines.append(f"%z{k} = zext {kind} %r{k} to i64")
        stored = f"double %r{k}" if kind == "double" else f"i64 %{'r' if width == 64 else 'z'}{k}"
        lines += [f"%p{k} = getelementptr i64, ptr %out, i64 {k}", f"store {stored}, ptr %p{k}"]
    body = "\n  ".join(lines)
    for line in lines:
        if "@llvm." in line:
            name = line.split("@")[1].split("(")[0]
            result = line.split("call ")[1].split(" @")[0]
            given = ", ".join(" ".join(one.split()[:-1]) for one in line.split(name + "(")[1].rstrip(")").split(", "))
            intrinsics.append(f"declare {result} @{name}({given})")
    return f"define i32 @f(i64 %a, i64 %b, double %x, double %y, ptr %out) {{\n  {body}\n  ret i32 0\n}}\n" + "\n".join(
        sorted(set(intrinsics))
    )


def whole_operations(kind):
    """Instructions of whole numbers of one width."""
    width, most = int(kind[1:]), 2 ** (int(kind[1:]) - 1) - 1
    found = [(kind, f"%r = {name} {kind} {{a}}, {{b}}") for name in ("add", "sub", "mul", "and", "or", "xor")]
    for name in ("shl", "lshr", "ashr"):
        within = f"%{{k}} = urem {kind} {{b}}, {min(width, most) if width > 1 else 1}"
        found.append((kind, f"{within}; %r = {name} {kind} {{a}}, %{{k}}"))
    if width > 1:
        for name in ("udiv", "urem"):
            found.append((kind, f"%{{k}} = or {kind} {{b}}, 1; %r = {name} {kind} {{a}}, %{{k}}"))
        chosen = f"%{{k}}t = icmp slt {kind} {{b}}, 0; %{{k}} = select i1 %{{k}}t, {kind} -3, {kind} 2"
        found += [(kind, f"{chosen}; %r = {name} {kind} {{a}}, %{{k}}") for name in ("sdiv", "srem")]
    cut = f"%{{k}}a = trunc i64 %a to {kind}; %{{k}}b = trunc i64 %b to {kind}; "
    left, right = ("%{k}a", "%{k}b") if width < 64 else ("%a", "%b")
    for order in ("eq", "ne", "ugt", "uge", "ult", "ule", "sgt", "sge", "slt", "sle"):
        compared = f"%{{k}} = icmp {order} {kind} {left}, {right}; %r = sext i1 %{{k}} to i64"
        found.append(("i64", (cut if width < 64 else "") + compared))
    if width < 64:
        found.append(("i64", f"%{{k}} = trunc i64 %a to {kind}; %r = sext {kind} %{{k}} to i64"))
    return found + (built_in(kind) if width in (8, 32, 64) else [])


def built_in(kind):
    """Functions of LLVM's on whole numbers."""
    two, found = f"({kind} {{a}}, {kind} {{b}})", []
    for name in ("smax", "smin", "umax", "umin", "uadd.sat", "usub.sat"):
        found.append((kind, f"%r = call {kind} @llvm.{name}.{kind}{two}"))
    for name in ("fshl", "fshr"):
        found.append((kind, f"%r = call {kind} @llvm.{name}.{kind}({kind} {{a}}, {kind} {{b}}, {kind} {{b}})"))
    found.append((kind, f"%r = call {kind} @llvm.ctpop.{kind}({kind} {{a}})"))
    for name in ("ctlz", "cttz", "abs"):
        found.append((kind, f"%r = call {kind} @llvm.{name}.{kind}({kind} {{a}}, i1 false)"))
    for name in ("uadd", "usub", "umul", "sadd", "ssub", "smul"):
        pair = f"{{{{ {kind}, i1 }}}}"
        call = f"%{{k}} = call {pair} @llvm.{name}.with.overflow.{kind}{two}"
        found.append((kind, f"{call}; %r = extractvalue {pair} %{{k}}, 0"))
        found.append((kind, f"{call}; %{{k}}e = extractvalue {pair} %{{k}}, 1; %r = sext i1 %{{k}}e to {kind}"))
    return found


def real_operations():
    """Instructions of floating-point numbers."""
    orders = "oeq ogt oge olt ole one ord ueq ugt uge ult ule une uno".split()
    found = [("i64", f"%{{k}} = fcmp {order} double %x, %y; %r = zext i1 %{{k}} to i64") for order in orders]
    found += [("double", f"%r = {name} double %x, %y") for name in ("fadd", "fsub", "fmul", "fdiv")]
    found += [("double", "%r = fneg double %x"), ("double", "%r = bitcast i64 %a to double")]
    found += [("i64", "%r = bitcast double %x to i64"), ("double", "%r = uitofp i64 %a to double")]
    single = "%{k} = fptrunc double %x to float; %{k}p = fmul float %{k}, 3.0"
    found.append(("double", f"{single}; %r = fpext float %{{k}}p to double"))
    size = "%{k} = call double @llvm.fabs.f64(double %y); %{k}b = fcmp olt double %{k}, 1.0e9"
    found.append(
        ("i64", f"{size}; %{{k}}c = select i1 %{{k}}b, double %y, double 7.5; %r = fptosi double %{{k}}c to i64")
    )
    for name in ("minnum", "maxnum"):  # of two zeros either may be the one
        call = f"%{{k}} = call double @llvm.{name}.f64(double %x, double %y)"
        found.append(("double", f"{call}; %r = fadd double %{{k}}, 0.0"))
    for name, count in (("copysign", 2), ("sqrt", 1), ("floor", 1), ("rint", 1), ("fma", 3)):
        given = ", ".join(["double %x", "double %y", "double %x"][:count])
        found.append(("double", f"%r = call double @llvm.{name}.f64({given})"))
    return found


OPERATIONS = [
    *(one for kind in ("i1", "i7", "i8", "i16", "i24", "i32", "i48", "i64") for one in whole_operations(kind)),
    *real_operations(),
]

VECTORS = """
define i32 @f(i64 %a, i64 %b, double %x, double %y, ptr %out) {
entry:
  %room = alloca [6 x double], align 8
  store <4 x double> <double 1.0, double 2.0, double -3.0, double 0.5>, ptr %room, align 8
  %v0 = insertelement <4 x double> poison, double %x, i64 0
  %v1 = shufflevector <4 x double> %v0, <4 x double> poison, <4 x i32> zeroinitializer
  %w = load <4 x double>, ptr %room, align 8
  %s = fmul <4 x double> %v1, %w
  %c = fcmp ogt <4 x double> %s, zeroinitializer
  %t = select <4 x i1> %c, <4 x double> %s, <4 x double> %w
  %i = insertelement <4 x i64> <i64 0, i64 8, i64 16, i64 24>, i64 0, i32 2
  %p = getelementptr i8, ptr %room, <4 x i64> %i
  %g = call <4 x double> @llvm.masked.gather.v4f64.v4p0(<4 x ptr> %p, i32 8, <4 x i1> %c, <4 x double> %t)
  %m = shufflevector <4 x double> %g, <4 x double> %t, <4 x i32> <i32 7, i32 0, i32 2, i32 5>
  store <4 x double> %m, ptr %out, align 8
  %e = extractelement <4 x double> %m, i64 2
  %q = getelementptr [4 x double], ptr %out, i64 1, i32 0
  %sum = call reassoc double @llvm.vector.reduce.fadd.v4f64(double %y, <4 x double> %t)
  store double %sum, ptr %q
  br label %loop
loop:
  %k = phi i64 [ 0, %entry ], [ %k1, %loop ]
  %l = phi double [ %x, %entry ], [ %r, %loop ]
  %r = phi double [ %y, %entry ], [ %l, %loop ]
  %k1 = add i64 %k, 1
  %u = and i64 %a, 7
  %d = icmp ult i64 %k, %u
  br i1 %d, label %loop, label %done
done:
  %q1 = getelementptr { i8, [3 x i16], double }, ptr %out, i64 2, i32 2
  store double %l, ptr %q1
  %bits = trunc i64 %b to i8
  switch i8 %bits, label %other [
    i8 -1, label %minus
    i8 7, label %seven
    i8 64, label %seven
  ]
minus:
  br label %other
seven:
  br label %other
other:
  %z = phi i64 [ 1, %done ], [ 2, %minus ], [ 3, %seven ]
  %pair = call { i64, double } @inner(i64 %z, double %r)
  %cb = bitcast <4 x i1> %c to i4
  %cw = zext i4 %cb to i64
  %q4 = getelementptr i64, ptr %out, i64 8
  store i64 %cw, ptr %q4
  %halves = bitcast i64 %a to <2 x i32>
  %swapped = shufflevector <2 x i32> %halves, <2 x i32> poison, <2 x i32> <i32 1, i32 0>
  %back = bitcast <2 x i32> %swapped to i64
  %q5 = getelementptr i64, ptr %out, i64 9
  store i64 %back, ptr %q5
  %z0 = extractvalue { i64, double } %pair, 0
  %z1 = extractvalue { i64, double } %pair, 1
  %q2 = getelementptr i64, ptr %out, i64 6
  store i64 %z0, ptr %q2
  %q3 = getelementptr i64, ptr %out, i64 7
  store double %z1, ptr %q3
  ret i32 0
}
define internal { i64, double } @inner(i64 %0, double %1) {
  %3 = getelementptr inbounds [3 x i64], ptr @table, i64 0, i64 %0
  %4 = getelementptr i8, ptr %3, i64 -8
  %5 = load i64, ptr %4
  %6 = insertvalue { i64, double } undef, i64 %5, 0
  %7 = load ptr, ptr @function
  %8 = call double %7(double %1)
  %9 = insertvalue { i64, double } %6, double %8, 1
  ret { i64, double } %9
}
define internal double @twice(double %x) {
  %y = fadd double %x, %x
  ret double %y
}
@table = internal constant [3 x i64] [i64 5, i64 -6, i64 7]
@function = internal global ptr @twice
declare double @llvm.vector.reduce.fadd.v4f64(double, <4 x double>)
declare <4 x double> @llvm.masked.gather.v4f64.v4p0(<4 x ptr>, i32, <4 x i1>, <4 x double>)
"""


@pytest.mark.parametrize("optimise", ["-O0", "-O1", "-O2"])
def test_instructions_are_those_of_llvm(tmp_path, optimise):
    """LLVM's own machine code of the same text."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    texts = [module_of(OPERATIONS), VECTORS]
    folders = [tmp_path / str(k) for k in range(len(texts))]
    word, real = ctypes.c_int64, ctypes.c_double
    whole = [numbers(WHOLE, 2**62, seed=seed) for seed in range(2)]
    x, y = (np.resize(numbers(REAL, 1e3, seed=seed), len(whole[0])) for seed in range(2))
    for text, folder in zip(texts, folders, strict=True):
        folder.mkdir()
        module = llvm.parse_assembly(text)
        printed = str(module)  # before machine code is made, which changes it
        count = len(OPERATIONS) if text is texts[0] else 10
        engine = llvm.create_mcjit_compiler(module, llvm.Target.from_default_triple().create_target_machine())
        engine.finalize_object()
        kinds = (ctypes.c_int32, word, word, real, real, ctypes.c_void_p)
        theirs = ctypes.CFUNCTYPE(*kinds)(engine.get_function_address("f"))
        ours = library([c_source(printed, "f", "f")], folder, optimise).f
        ours.argtypes = kinds[1:]
        columns = whole[0].tolist(), np.roll(whole[1], 3).tolist(), x.tolist(), np.roll(y, 5).tolist()
        for given in zip(*columns, strict=True):
            wanted, found = np.zeros(count, np.uint64), np.zeros(count, np.uint64)
            theirs(*given, wanted.ctypes.data)
            ours(*given, found.ctypes.data)
            off = (found != wanted) & ~(np.isnan(found.view(float)) & np.isnan(wanted.view(float)))
            told = [OPERATIONS[k] for k in np.flatnonzero(off)[:3]] if text is texts[0] else np.flatnonzero(off)
            assert not off.any(), (given, told)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("%r = atomicrmw add ptr %out, i64 1 seq_cst", "'atomicrmw'"),
        ("%r = call i64 @elsewhere(i64 %a)\n  store i64 %r, ptr %out", "elsewhere"),
        ("%w = sext i64 %a to i128\n  %r = trunc i128 %w to i64\n  store i64 %r, ptr %out", "128 bits"),
        ("%r = call i64 @llvm.bitreverse.i64(i64 %a)\n  store i64 %r, ptr %out", "llvm.bitreverse"),
        ("%r = load volatile i64, ptr %out\n  store i64 %r, ptr %out", "shared"),
    ],
)
def test_what_has_no_c_is_named(line, words):
    text = f"define i32 @f(i64 %a, ptr %out) {{\n  {line}\n  ret i32 0\n}}\ndeclare i64 @elsewhere(i64)\n"
    text += "declare i64 @llvm.bitreverse.i64(i64)\n"
    with pytest.raises(ExportError, match=words):
        c_source(str(llvm.parse_assembly(text)), "f", "f")
