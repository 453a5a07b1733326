"""Compile functions that only kernels call into each of those kernels, and never by themselves.

Numba makes machine code of every function that it compiles, with two wrappers for calls from outside, and again for
all that the function calls. A function five calls deep is optimised fifteen times, although only the code in the kernel
runs. Here a function becomes half-optimised bitcode for its callers; a call from Python gets a kernel of its own. That
halves the time of compiling. Bitcode is stored on disk like kernels.
"""

from typing import Any, Self

from llvmlite import binding
from numba.core.caching import CompileResultCacheImpl
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import NativeLowering

OPTIONS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}  # of Numba, which go with LinkedCompiler


class _NoEngine:
    """Numba's code generator for code that never runs: it has no address for an environment."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, env_name: str, env: object) -> None:
        """Note nothing."""


class _Linked(JITCodeLibrary):
    """A function's code, to be linked into kernels."""

    @property
    def codegen(self) -> _NoEngine:
        """The code generator."""
        return _NoEngine(self._codegen)

    def _optimize_final_module(self) -> None:
        """Run the cheap passes; the kernel runs the rest.

        Without any, some kernels would compile for minutes, because callees are inlined before anything else.
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

    def serialize_using_object_code(self) -> tuple[str, bytes]:
        """Return the name and the bitcode, to be stored."""
        return self.name, self._final_module.as_bitcode()


class _FromBitcode:
    """Numba's target context, except that it reads the stored bitcode of a `_Linked`."""

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def codegen(self) -> Self:
        """Return itself, which stands in for the code generator."""
        return self

    def unserialize_library(self, kept: tuple[str, bytes]) -> _Linked:
        """Return the library of kept bitcode."""
        library = _Linked(self._context.codegen(), kept[0])
        library._final_module, library._finalized = binding.parse_bitcode(kept[1]), True
        return library


class LinkedCacheImpl(CompileResultCacheImpl):
    """Numba's reader of kept functions, without machine code."""

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return the compiled function."""
        made = super().rebuild(_FromBitcode(target_context), payload)  # type: ignore[no-untyped-call]
        return made._replace(target_context=target_context)


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
