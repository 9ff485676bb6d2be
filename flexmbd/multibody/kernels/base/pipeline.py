"""How numba compiles kernels: by the passes they need, and to machine code only where something enters them.

numba by itself optimises every function alone, with all that it calls, before it becomes part of another one. Kernels
that kernels alone call are kept as they were translated (``PartLibrary``), and optimised with what enters them.

This module, ``translation``, ``part_cache`` and ``struct_type`` are where the package leans on numba's inside; the
versions that they were run with bound what is installed.  With FLEXMBD_PLAIN_NUMBA set, and where a numba has no passes
by these names, numba's own list of passes is taken: kernels are the same and take longer to compile.
"""

from __future__ import annotations

import hashlib
import os
from typing import Any

import llvmlite.binding as llvm
from numba.core import typed_passes, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, CompileResult, DefaultPassBuilder, Flags, compile_result
from numba.core.compiler_machinery import LoweringPass, PassManager, register_pass
from numba.core.typing import signature

from flexmbd.multibody.kernels.base.entry_code import add_entry

#: numba's passes but those that only closures, objects and parallel loops need, by its modules' names.
_TO_LLVM = (
    (untyped_passes, "TranslateByteCode"),
    (untyped_passes, "FixupArgs"),
    (untyped_passes, "IRProcessing"),
    (untyped_passes, "RewriteSemanticConstants"),
    (untyped_passes, "DeadBranchPrune"),
    (untyped_passes, "GenericRewrites"),
    (untyped_passes, "ReconstructSSA"),
    (typed_passes, "NopythonTypeInference"),
    (typed_passes, "PreLowerStripPhis"),
    (typed_passes, "NoPythonSupportedFeatureValidation"),
    (typed_passes, "IRLegalization"),
    (typed_passes, "AnnotateTypes"),
    (typed_passes, "NativeLowering"),
)


class _KernelFlags(Flags):
    """Flags that are compared by what is set.

    numba looks up some ten thousands of its own functions by them for each method of integration, and compares all of
    their sixty properties one by one each time: a fifth of the time that types take to be found.
    """

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _KernelFlags) and self._values == other._values

    def __hash__(self) -> int:
        return len(self._values)


class _KernelCompiler(CompilerBase):
    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.flags = _KernelFlags(self.state.flags)


class EntryCompiler(_KernelCompiler):
    """Compiles what Python, or a call through an address, enters."""

    def define_pipelines(self) -> list[PassManager]:
        """Numba's passes, and machine code with a way in."""
        self.state.flags.no_compile = True
        codegen = self.state.targetctx.codegen()
        self.state.library = EntryLibrary(codegen, self.state.func_id.func_qualname)
        return [_manager(self.state, _EntryBackend)]


class PartCompiler(_KernelCompiler):
    """Compiles what kernels alone call."""

    def define_pipelines(self) -> list[PassManager]:
        """As ``EntryCompiler``, without machine code."""
        self.state.flags.no_compile = True
        codegen = self.state.targetctx.codegen()
        self.state.library = PartLibrary(codegen, self.state.func_id.func_qualname)
        return [_manager(self.state, _PartBackend)]


def _manager(state: Any, backend: Any) -> PassManager:
    manager = PassManager("kernel")
    for one in (*_passes(state), backend):
        manager.add_pass(one, one.__name__)
    manager.finalize()
    return manager


def _passes(state: Any) -> list[Any]:
    """From a function's text to LLVM's: those above, or numba's own list."""
    known = [getattr(module, name, None) for module, name in _TO_LLVM]
    if all(known) and not os.environ.get("FLEXMBD_PLAIN_NUMBA"):
        return known
    own = DefaultPassBuilder.define_nopython_pipeline(state).passes
    return [one for one, _ in own if one is not typed_passes.NoPythonBackend]


class EntryLibrary(JITCodeLibrary):
    """Object code of a kernel with what it calls, which nobody else sees: what has one caller becomes its text.

    numba does not load it: see ``machine_code``.

    Attributes:
        code: object code for this processor.
        names: symbols of the library's own functions, by what they were called before.
    """

    code: bytes
    names: dict[str, str]

    def finalize(self) -> None:
        """Join what the kernel calls, optimise and compile."""
        self._raise_if_finalized()
        module = self._final_module
        own = {one.name for one in module.functions if not one.is_declaration}
        for library in dict.fromkeys(self._linking_libraries):
            module.link_in(library._get_module_for_linking(), preserve=True)
        mark = hashlib.sha256("".join(sorted(own)).encode()).hexdigest()[:8]
        for one in module.functions:
            if not one.is_declaration and one.name not in own:
                one.linkage = "internal"
                # LLVM may change what it takes, and the loader finds local functions by their names, too
                one.name = f"{one.name}.{mark}"
        for one in module.global_variables:
            if one.linkage == llvm.Linkage.linkonce_odr:  # addresses of deferred kernels: each entry has its own
                one.linkage = "internal"
        self._optimize_final_module()
        module.verify()
        self._finalize_dynamic_globals()
        # of two programs under one name, as of a function within a function, each has its own code
        mark = hashlib.sha256(module.as_bitcode()).hexdigest()[:16]
        self.names = {name: f"{name}.{mark}" for name in own}
        for one in module.functions:
            if one.name in own:
                one.name = self.names[one.name]
        for one in module.global_variables:
            if not one.is_declaration and one.linkage != llvm.Linkage.internal and one.linkage != llvm.Linkage.private:
                one.linkage = "internal"
        self.code = self._codegen._tm.emit_object(module)
        self._finalized = True


class PartLibrary(JITCodeLibrary):
    """A function with what it calls, as translated; it is optimised with the kernel that it becomes part of."""

    def finalize(self) -> None:
        """Join what the function calls."""
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()
        self._finalized = True

    @classmethod
    def of(cls, codegen: Any, name: str, bitcode: bytes) -> PartLibrary:
        """What ``as_bitcode`` of a library's module gave."""
        self = cls(codegen, name)
        self._final_module = llvm.parse_bitcode(bitcode)
        self._finalized = True
        return self


class _Part:
    """What a call of a function without machine code is looked up by."""


class _Backend(LoweringPass):
    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Makes the function's library, and offers the function to those that call it."""
        part, lowered = _Part(), state["cr"]
        self.finish(state, lowered.fndesc)
        state.targetctx.insert_user_function(part, lowered.fndesc, [state.library])
        state.cr = compile_result(
            typing_context=state.typingctx,
            target_context=state.targetctx,
            entry_point=part,
            typing_error=None,
            type_annotation=None,
            library=state.library,
            call_helper=None,
            signature=signature(state.return_type, *state.args),
            objectmode=False,
            lifted=(),
            fndesc=lowered.fndesc,
            environment=None,
            metadata=None,
            reload_init=[],
        )
        return True

    def finish(self, state: Any, fndesc: Any) -> None:
        """Nothing for a part, whose library is ready as it is."""


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartBackend(_Backend):
    _name = "flexmbd_part_backend"


@register_pass(mutates_CFG=True, analysis_only=False)
class _EntryBackend(_Backend):
    _name = "flexmbd_entry_backend"

    def finish(self, state: Any, fndesc: Any) -> None:
        """Adds the C function by which the kernel is entered, and compiles both."""
        add_entry(state.targetctx, state.library, fndesc)
        state.library.finalize()


def part_payload(compiled: CompileResult) -> tuple[Any, ...]:
    """What is written of a function that was translated."""
    compiled.fndesc.typemap = compiled.fndesc.calltypes = None
    compiled.library._ensure_finalized()
    return compiled.library.name, compiled.library._final_module.as_bitcode(), compiled.fndesc, compiled.signature


def part_from(target_context: Any, name: str, bitcode: bytes, fndesc: Any, sig: Any) -> CompileResult:
    """The function of which this was written, as if compiled."""
    return compile_result(
        typing_context=target_context.typing_context,
        target_context=target_context,
        entry_point=_Part(),
        library=PartLibrary.of(target_context.codegen(), name, bitcode),
        signature=sig,
        objectmode=False,
        fndesc=fndesc,
        lifted=(),
    )
