"""Compiling functions that only kernels call: into each kernel, and never by themselves.

Numba makes machine code of every function that it compiles, with two wrappers for calls from outside, and again of all
that the function calls. A function five calls deep is so optimised fifteen times, though in the end only the code in
the kernel runs. Here a function is handed on as it is, and what calls it from Python, if anything does, gets a kernel
of its own. That halves the time of compiling.
"""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import NativeLowering

OPTIONS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}  # of Numba, which go with LinkedCompiler


class _NoEngine:
    """Numba's code generator for code that is not to run: it has no address at which to note an environment."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, env_name: str, env: object) -> None:
        """Note nothing."""


class _Linked(JITCodeLibrary):
    """A function's code as it is to be linked into kernels."""

    @property
    def codegen(self) -> _NoEngine:
        """The code generator."""
        return _NoEngine(self._codegen)

    def _optimize_final_module(self) -> None:
        """Do the cheap half; the rest is for the kernel.

        With nothing done, some kernels would take minutes: callees are taken in before anything else.
        """
        passes, builder = self._codegen._module_pass_manager(  # type: ignore[no-untyped-call]
            loop_vectorize=False, slp_vectorize=False, opt=self._codegen._opt_level, cost="cheap"
        )
        passes.run(self._final_module, builder)

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: there is no machine code."""
        return 0


@register_pass(mutates_CFG=False, analysis_only=True)  # type: ignore[no-untyped-call]
class _TakeLinked(LoweringPass):
    """Have Numba write into our library."""

    _name = "take_linked"

    def __init__(self) -> None:
        LoweringPass.__init__(self)  # type: ignore[no-untyped-call]

    def run_pass(self, state: Any) -> bool:
        """Make the library; return whether the function has changed."""
        state.library = _Linked(state.targetctx.codegen(), state.func_id.func_qualname)
        return False


class LinkedCompiler(CompilerBase):
    """Numba's compiler up to the point at which machine code would be made."""

    def define_pipelines(self) -> list[Any]:
        """Return the one pipeline."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)  # type: ignore[no-untyped-call]
        lowering = [one for one, _ in passes.passes].index(NativeLowering)
        passes.passes.insert(lowering, (_TakeLinked, "take our library"))
        passes.finalize()
        return [passes]
