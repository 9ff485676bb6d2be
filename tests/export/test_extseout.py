"""Superelements as MSC and NX Nastran write them by EXTSEOUT: OP4 of every layout, with the deck that says the rows."""

import math
import struct
import subprocess
import sys

import numpy as np
import pytest
from exported_bodies import damped_rod
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.errors import ExportError
from flexmbd.export import InterfaceNode


def strings(column):
    """First and behind-last row of each run of numbers that are not zero."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], column != 0.0, [0]])))
    return list(zip(edges[::2], edges[1::2], strict=True))


def text_op4(matrices, layout, kind=2):
    """OP4 as text: numbers of 23 characters, three a line."""
    lines = []
    for name, A in matrices:
        rows, columns = A.shape
        lines.append(f"{columns:8d}{-rows if layout == 'bigmat' else rows:8d}{6:8d}{kind:8d}{name:8s}1P,3E23.16")
        for j, column in enumerate(A.T):
            runs = strings(column)
            if not runs:
                continue
            if layout == "dense":
                runs = [(runs[0][0], runs[-1][1])]
            body, words = [], 0
            for a, b in runs:
                length = (b - a) * (1 if layout == "dense" else kind)
                words += length + {"dense": 0, "sparse": 1, "bigmat": 2}[layout]
                body += {
                    "dense": [],
                    "sparse": [f"{(a + 1) + 65536 * (length + 1):12d}"],
                    "bigmat": [f"{length + 1:8d}{a + 1:8d}"],
                }[layout]
                numbers = [f"{x:23.16E}" for x in column[a:b]]
                body += ["".join(numbers[i : i + 3]) for i in range(0, len(numbers), 3)]
            lines.append(f"{j + 1:8d}{runs[0][0] + 1 if layout == 'dense' else 0:8d}{words:8d}")
            lines += body
        lines += [f"{columns + 1:8d}{1:8d}{1:8d}", f"{1.0:23.16E}"]
    return ("\n".join(lines) + "\n").encode()


def binary_op4(matrices, layout, *, order="<", word=4):
    """OP4 in binary form, double precision; words of eight bytes hold four letters of a name each."""
    whole = "i" if word == 4 else "q"

    def record(*parts):
        content = b"".join(parts)
        length = struct.pack(order + "i", len(content))
        return length + content + length

    def ints(*values):
        return struct.pack(f"{order}{len(values)}{whole}", *values)

    data = b""
    for name, A in matrices:
        rows, columns = A.shape
        letters = f"{name:8s}" if word == 4 else f"{name[:4]:8s}{name[4:8]:8s}"
        data += record(ints(columns, -rows if layout == "bigmat" else rows, 6, 2), letters.encode())
        for j, column in enumerate(A.T):
            runs = strings(column)
            if not runs:
                continue
            if layout == "dense":
                runs = [(runs[0][0], runs[-1][1])]
            parts = []
            for a, b in runs:
                length = (b - a) * 8 // word
                if layout == "sparse":
                    parts.append(ints((a + 1) + 65536 * (length + 1)))
                elif layout == "bigmat":
                    parts.append(ints(length + 1, a + 1))
                parts.append(column[a:b].astype(order + "f8").tobytes())
            words = sum(map(len, parts)) // word
            data += record(ints(j + 1, runs[0][0] + 1 if layout == "dense" else 0, words), *parts)
        data += record(ints(columns + 1, 1, 8 // word), struct.pack(order + "d", 1.0))
    return data


def rod_matrices():
    element = fm.export.superelement(damped_rod())
    ends = {name: InterfaceNode(p) for name, p in zip(element.names, element.p, strict=True)}
    return element, ends


def same_body(found, wanted, *, rtol=1e-9):
    np.testing.assert_allclose(found.mass, wanted.mass, rtol=rtol)
    np.testing.assert_allclose(found.frequencies(), wanted.frequencies(), rtol=rtol)
    principal = np.linalg.eigvalsh(wanted.inertia)
    np.testing.assert_allclose(np.linalg.eigvalsh(found.inertia), principal, rtol=0.0, atol=rtol * principal[-1])


@pytest.mark.parametrize("layout", ["dense", "sparse", "bigmat"])
@pytest.mark.parametrize(
    "write",
    [
        text_op4,
        lambda m, s: text_op4(m, s, kind=1),
        binary_op4,
        lambda m, s: binary_op4(m, s, order=">"),
        lambda m, s: binary_op4(m, s, word=8),
        lambda m, s: binary_op4(m, s, order=">", word=8),
    ],
)
def test_every_layout_holds_the_same_numbers(tmp_path, layout, write):
    """Among matrices of other kinds: K4XX of zeros, one zero for no damping, loads of another size."""
    element, ends = rod_matrices()
    n = len(element.K)
    holes = np.zeros((70000, 3))
    holes[[0, 2, 3, 69999], [0, 0, 1, 1]] = 1.0
    matrices = [("KAA", element.K), ("MAA", element.M), ("BXX", np.zeros((1, 1))), ("K4XX", np.zeros((n, n)))]
    (tmp_path / "part.op4").write_bytes(write([*matrices, ("PA", element.K[:, :2])], layout))
    found = fm.export.read_op4(tmp_path / "part.op4", interfaces=ends)
    (tmp_path / "plain.op4").write_bytes(text_op4(matrices[:2], "dense"))
    wanted = fm.export.read_op4(tmp_path / "plain.op4", interfaces=ends)
    assert np.array_equal(found.gram, wanted.gram)
    assert np.array_equal(found.stiffness, wanted.stiffness)
    if layout == "bigmat":  # which is there for matrices of many rows
        (tmp_path / "tall.op4").write_bytes(write([*matrices, ("PA", holes)], layout))
        assert np.array_equal(fm.export.read_op4(tmp_path / "tall.op4", interfaces=ends).gram, wanted.gram)


def large(name, *fields):
    """A card in large fields."""
    words = [f"{x:16.9E}" if isinstance(x, float) else f"{x:16d}" if isinstance(x, int) else f"{x:16s}" for x in fields]
    words += [""] * (-len(words) % 4)
    lines = ["".join(words[i : i + 4]) for i in range(0, len(words), 4)]
    return [f"{name + '*':8s}{lines[0]}", *(f"{'*':8s}{line}" for line in lines[1:])]


def turned_deck(element, *, rows="extrn", seed=0):
    """Cards of GRIDs in nested systems of their own, and the rotation of each GRID's displacements to the basic axes.

    System 5 is rectangular in the basic one, 6 cylindrical in 5, 7 spherical in 6; GRID 30 + i stands in system 5 + i
    and moves along 6 + i.
    """
    random = np.random.default_rng(seed)
    axes, origins, lines = {0: np.eye(3)}, {0: np.zeros(3)}, []

    def local(system, point):
        """Coordinates of a point in a system, angles in degrees."""
        x, y, z = axes[system].T @ (point - origins[system])
        r = math.hypot(x, y)
        if system == 6:
            return [r, math.degrees(math.atan2(y, x)), z]
        if system == 7:
            return [math.hypot(r, z), math.degrees(math.atan2(r, z)), math.degrees(math.atan2(y, x))]
        return [x, y, z]

    for number, kind, base in ((5, "R", 0), (6, "C", 5), (7, "S", 6)):
        R, o = Rotation.random(random_state=random).as_matrix(), random.normal(size=3)
        points = [o, o + 2.0 * R[:, 2], o + 1.5 * R[:, 0] - 0.7 * R[:, 2]]
        lines += large(f"CORD2{kind}", number, base, *(float(x) for p in points for x in local(base, p)))
        axes[number], origins[number] = R, o
    turns = []
    for i, p in enumerate(element.p):
        cp, cd = 5 + i, 6 + i
        lines += large("GRID", 30 + i, cp, *map(float, local(cp, p)), cd, "", "")
        up = axes[cd][:, 2]
        across = (p - origins[cd]) - up * (up @ (p - origins[cd]))
        radial = across / np.linalg.norm(across)
        around = np.cross(up, radial)
        outwards = (p - origins[cd]) / np.linalg.norm(p - origins[cd])
        turns.append(
            np.column_stack([radial, around, up])
            if cd == 6
            else np.column_stack([outwards, np.cross(around, outwards), around])
        )
    m, grids = element.n_modes, range(30, 30 + len(element.p))
    if rows == "extrn":
        fields = [w for g in grids for w in (g, 123456)] + [w for k in range(m) for w in (501 + k, 0)]
        lines += [
            ("EXTRN   " if at == 0 else " " * 8) + "".join(f"{w:8d}" for w in fields[at : at + 8])
            for at in range(0, len(fields), 8)
        ]
    else:
        pairs = "".join(f"{g:8d}{g:8d}" for g in grids)
        lines += [f"SECONCT {9:8d}{0:8d}", " " * 8 + pairs]
        lines += [" " * 8 + f"{501:8d}    THRU{500 + m:8d}{501:8d}    THRU{500 + m:8d}"]
        lines += [f"SPOINT  {501:8d}    THRU{500 + m:8d}"]
    return "\n".join(["$ a comment", "BEGIN SUPER 9", *lines]) + "\n", turns


def turned(matrix, turns):
    """Rows along the GRIDs' own directions."""
    T = np.eye(len(matrix))
    for i, R in enumerate(turns):
        for at in (6 * i, 6 * i + 3):
            T[at : at + 3, at : at + 3] = R
    return T.T @ matrix @ T


@pytest.mark.parametrize(("rows", "suffix"), [("extrn", ".pch"), ("seconct", ".asm")])
@pytest.mark.parametrize("seed", range(3))
def test_a_deck_beside_the_matrices(tmp_path, rows, suffix, seed):
    """GRIDs stand and move in rectangular, cylindrical and spherical systems, one in the other."""
    element, _ = rod_matrices()
    text, turns = turned_deck(element, rows=rows, seed=seed)
    (tmp_path / f"part{suffix}").write_text(text)
    matrices = [(name, turned(A, turns)) for name, A in (("KXX", element.K), ("MXX", element.M), ("BXX1", element.D))]
    (tmp_path / "part.op4").write_bytes(binary_op4(matrices, "bigmat"))
    found = fm.export.read_op4(tmp_path / "part.op4")
    assert [one.name for one in found.interfaces] == ["grid 30", "grid 31"]
    # large fields have ten digits
    same_body(found, damped_rod(), rtol=1e-7)
    far = np.linalg.norm(element.p[1] - element.p[0])
    np.testing.assert_allclose(np.linalg.norm(found.interfaces[1].p_BI_B), far, rtol=1e-8)
    wanted = damped_rod().frequencies(["big_end"])
    np.testing.assert_allclose(found.frequencies(["grid 30"]), wanted, rtol=1e-7)
    np.testing.assert_allclose(np.trace(found.damping), np.trace(damped_rod().damping), rtol=1e-6)


def test_a_deck_that_lost_its_grdset(tmp_path):
    """A GRID without CD moves along the basic axes unless GRDSET says otherwise; what is then refused says so."""
    element, _ = rod_matrices()
    text, turns = turned_deck(element)
    place = element.p[0]
    start = text.index("GRID*")
    end = text.index("GRID*", start + 1)
    blank = "\n".join(large("GRID", 30, "0", *map(float, place), "", "", "")) + "\n"
    (tmp_path / "part.pch").write_text(text[:start] + blank + text[end:])
    matrices = [(name, turned(A, turns)) for name, A in (("KAA", element.K), ("MAA", element.M))]
    (tmp_path / "part.op4").write_bytes(text_op4(matrices, "sparse"))
    with pytest.raises(ExportError, match=r"GRIDs 30 have no CD, and others have one: where GRDSET"):
        fm.export.read_op4(tmp_path / "part.op4")
    given = text[:start] + blank + text[end:]
    for with_default in ("GRDSET,,,,,,6\n" + given, given + "GRDSET,,5,,,,6\n"):  # wherever it stands; CP 0 is no blank
        (tmp_path / "part.pch").write_text(with_default)
        same_body(fm.export.read_op4(tmp_path / "part.op4"), damped_rod(), rtol=1e-7)


def test_dmig_moves_along_the_grids_own_directions(tmp_path):
    element, _ = rod_matrices()
    text, turns = turned_deck(element)
    dofs = [(30 + i, c) for i in range(2) for c in range(1, 7)] + [(501 + k, 0) for k in range(element.n_modes)]
    lines = [f"DMIG,PAX,0,9,2,0,,,{1:d}", "DMIG,PAX,1,0,,30,1,5.0", "DMIG,KASM,0,6,2,0"]
    for name, A in (("KAAX", turned(element.K, turns)), ("MAAX", turned(element.M, turns))):
        lines.append(f"DMIG,{name},0,1,2,0")
        for j, (node, c) in enumerate(dofs):
            for i, (row, d) in enumerate(dofs):
                if A[i, j] != 0.0:
                    lines += [f"DMIG*,{name},{node},{c},,", f"*,{row},{d},{float(A[i, j])!r},"]
    (tmp_path / "part.pch").write_text(text + "\n".join(lines) + "\n")
    found = fm.export.read_dmig(tmp_path / "part.pch")
    same_body(found, damped_rod(), rtol=1e-7)


def test_grids_that_carry_no_frame_stay_free(tmp_path):
    """One that moves along y alone, the other five motions being modes; and one that is not named."""
    element, _ = rod_matrices()
    n, m = len(element.K), element.n_modes
    T = np.eye(n)
    motions = element.rigid_motions(element.p[0])
    for row in (6, 8, 9, 10, 11):  # all of the second GRID but y are taken against the first one
        T[row, :6] = motions[row]
    back = [*range(6), 7, *range(12, n), 6, 8, 9, 10, 11]
    modes = "".join(f"{501 + k:8d}{0:8d}" for k in range(m + 5))
    lines = [f"GRID,{7 + i},,{p[0]!r},{p[1]!r},{p[2]!r}" for i, p in enumerate(element.p.tolist())]
    fields = f"{7:8d}{123456:8d}{8:8d}{2:8d}{modes}"
    lines += [("EXTRN   " if at == 0 else " " * 8) + fields[at : at + 64] for at in range(0, len(fields), 64)]
    (tmp_path / "part.pch").write_text("\n".join(lines))
    matrices = [(name, (T.T @ A @ T)[np.ix_(back, back)]) for name, A in (("KAA", element.K), ("MAA", element.M))]
    (tmp_path / "part.op4").write_bytes(text_op4(matrices, "sparse"))
    found = fm.export.read_op4(tmp_path / "part.op4")
    assert [one.name for one in found.interfaces] == ["grid 7"]
    same_body(found, damped_rod())
    text, turns = turned_deck(element)
    (tmp_path / "all.pch").write_text(text)
    matrices = [(name, turned(A, turns)) for name, A in (("KAA", element.K), ("MAA", element.M))]
    (tmp_path / "all.op4").write_bytes(text_op4(matrices, "dense"))
    found = fm.export.read_op4(tmp_path / "all.op4", interfaces={"small": InterfaceNode(node=31)})
    assert [one.name for one in found.interfaces] == ["small"]
    same_body(found, damped_rod(), rtol=1e-7)
    wanted = damped_rod().frequencies(["small_end"])
    np.testing.assert_allclose(found.frequencies(["small"]), wanted, rtol=1e-7)


def test_structural_damping_at_a_frequency(tmp_path):
    """K4 = g K does at the frequency w4 the work of the viscous g K / w4."""
    element, ends = rod_matrices()
    matrices = [("KAA", element.K), ("MAA", element.M), ("K4XX", 0.03 * element.K)]
    path = tmp_path / "part.op4"
    path.write_bytes(text_op4(matrices, "sparse"))
    with pytest.raises(ExportError, match="K4XX is structural damping, in the units of a stiffness"):
        fm.export.read_op4(path, interfaces=ends)
    found = fm.export.read_op4(path, interfaces=ends, w4=500.0)
    damping = 0.03 / 500.0 * found.stiffness
    np.testing.assert_allclose(found.damping, np.diag(damping), rtol=0.0, atol=1e-9 * damping.max())
    assert not fm.export.read_op4(path, interfaces=ends, w4=math.inf).damping.any()
    for wrong, match in (({"D": "K4XX"}, "structural damping"), ({"C": "BXX"}, "no role 'C'"), ({"K": "KXX"}, "KXX")):
        with pytest.raises(ExportError, match=match):
            fm.export.read_op4(path, interfaces=ends, matrices=wrong)
    for wrong in (-1.0, math.nan, "300"):
        with pytest.raises(ExportError, match="angular frequency in rad/s"):
            fm.export.read_op4(path, interfaces=ends, w4=wrong)
    with pytest.raises(ExportError, match="matrices must be a mapping"):
        fm.export.read_op4(path, interfaces=ends, matrices="KAA")


def test_matrices_chosen_by_name(tmp_path):
    """Two bodies in a file, as OUTPUT4 in a loop writes them: the second one by the matrices' places."""
    element, ends = rod_matrices()
    double = [("KAA", 4.0 * element.K), ("MAA", element.M), ("KAA", element.K), ("MAA", element.M)]
    (tmp_path / "two.op4").write_bytes(binary_op4(double, "sparse"))
    with pytest.raises(ExportError, match="it holds KAA:1, MAA:1, KAA:2, MAA:2: say which"):
        fm.export.read_op4(tmp_path / "two.op4", interfaces=ends)
    found = fm.export.read_op4(tmp_path / "two.op4", interfaces=ends, matrices={"K": "kaa:1", "M": "MAA:1"})
    np.testing.assert_allclose(found.frequencies(), 2.0 * damped_rod().frequencies(), rtol=1e-9)


def test_what_does_not_fit(tmp_path):
    element, ends = rod_matrices()
    n = len(element.K)
    path = tmp_path / "part.op4"

    def refused(match, matrices, **arguments):
        path.write_bytes(binary_op4(matrices, "sparse"))
        with pytest.raises(ExportError, match=match):
            fm.export.read_op4(path, **arguments)

    refused(rf"KAA is of size .{n}, {n}., MAA of .{n - 1}", [("KAA", element.K), ("MAA", element.M[1:, 1:])],
            interfaces=ends)  # fmt: skip
    whole = [("KAA", element.K), ("MAA", element.M)]
    refused("does not say which interfaces", whole)
    rows = f"EXTRN,1,123456,2,THRU,{n - 5},0\n"
    decks = {
        "names 12 rows, and the matrices of": "GRID,1\nGRID,2\nEXTRN,1,123456,2,123456\n",
        "has neither EXTRN nor SECONCT": "GRID,1\n",
        "are no components": "GRID,1\nEXTRN,1,7\n",
        "twice": "GRID,1\nEXTRN,1,12,1,2\n",
        "no superelement's": "SPOINT,1,THRU,99999999\n",
        "coordinate system 4 is used and not given": "GRID,1,4\n" + rows,
        r"line 2: coordinate system 4 hangs on itself": "GRID,1,4\nCORD2R,4,4,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\n" + rows,
        "the three points of CORD2R 4 lie on a line": "GRID,1,4\nCORD2R,4,,0.,0.,0.,0.,0.,1.\n,0.,0.,2.\n" + rows,
        "on the axis of": "GRID,1,,,,,4\nCORD2C,4,,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\n" + rows,
    }
    for match, deck in decks.items():
        (tmp_path / "deck.pch").write_text(deck)
        refused(match, whole, deck=tmp_path / "deck.pch")
    holed = [(name, A.copy()) for name, A in whole]
    for _, A in holed:
        A[3], A[:, 3] = 0.0, 0.0
    (tmp_path / "deck.pch").write_text(turned_deck(element)[0])
    refused("component 4 of GRID 30 has neither stiffness nor mass", holed, deck=tmp_path / "deck.pch",
            interfaces={"a": InterfaceNode(node=30)})  # fmt: skip


_CHILD = """
import resource, sys
import scipy.linalg, scipy.sparse  # a thread of OpenBLAS that finds no room at its start waits for ever
import flexmbd.export
import flexmbd as fm
from flexmbd.errors import ExportError

pages = int(open("/proc/self/statm").read().split()[0])
resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + 2**27,) * 2)
for path in sys.argv[1:]:
    read = fm.export.read_dmig if path.endswith(".pch") else fm.export.read_op4
    try:
        read(path, interfaces={"a": fm.export.InterfaceNode((0, 0, 0), 1)})
    except ExportError as error:
        print(str(error).replace(path, ""))
"""


def test_files_that_claim_more_than_there_is(tmp_path):
    """In a process that may take 128 MB: short files of matrices of 5000 rows and more, and of points without end."""
    rows = 5000
    one = [("KAA", np.eye(8)), ("MAA", np.eye(8))]
    for at, (big, word) in enumerate([("sparse", 4), ("bigmat", 4), ("bigmat", 8)]):
        data = binary_op4(one, big, word=word)
        head = struct.pack("<2i" if word == 4 else "<2q", 8, 8 if big == "sparse" else -8)
        for claim in (rows, 2**31 - 2):
            new = struct.pack("<2i" if word == 4 else "<2q", 8, claim if big == "sparse" else -claim)
            (tmp_path / f"b{at}{claim}.op4").write_bytes(data.replace(head, new))
    text = text_op4([("KAA", np.eye(8))], "sparse").decode()
    text = text.replace(f"{8:8d}{8:8d}", f"{rows:8d}{rows:8d}").replace(f"{9:8d}", f"{rows + 1:8d}")
    (tmp_path / "text.op4").write_text(text)
    (tmp_path / "points.pch").write_text("SPOINT,1,THRU,99999999\n")
    far = "".join(f"DMIG,K,{i},1,,{i},1,1.\n" for i in range(1, 9000))
    (tmp_path / "far.pch").write_text("DMIG,K,0,6,2,0\n" + far)
    files = sorted(str(path) for path in tmp_path.iterdir())
    done = subprocess.run([sys.executable, "-c", _CHILD, *files], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == len(files), done.stdout
    assert "too short to hold" in done.stdout
    assert "read are real ones of 1 to 5000" in done.stdout
