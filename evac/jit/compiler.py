"""Compilation of kernels: numba's front end for each function once, then LLVM for all functions of an entry together.

The dispatcher of numba optimises each function by itself and again in each of its callers. Here, functions are kept as
they were lowered, and only the functions that an entry reaches are linked and optimised. This module is imported only
to compile.
"""

import dis
import gc
import os
import re
from collections.abc import Generator
from contextlib import contextmanager
from functools import lru_cache
from importlib import import_module
from typing import Any

import numba
from llvmlite import binding as llvm
from llvmlite import ir
from numba import types
from numba.core import codegen, compiler, cpu, dispatcher, typed_passes, typing, untyped_passes
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import PassManager
from numba.core.descriptors import TargetDescriptor
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys
from numba.core.typing import mathdecl, templates
from numba.core.typing.typeof import typeof_impl
from numba.cpython import mathimpl

from evac.base.errors import PluginError, fault
from evac.jit.instructions import BUILTINS, type_of
from evac.jit.kernels import NOTE_RAISED, Entry, Kernel
from evac.jit.loading import host
from evac.jit.store import kernels_in

# numba reads this file before each compilation. One of the current folder must not decide what is compiled.
numba.core.config._config_fname = os.devnull

# The elimination of redundant loads would take a third of the time, mostly for loads that depend on many blocks.
llvm.set_option("evac", "-memdep-block-number-limit=50")

#: LLVM's level of optimisation, whatever numba's is: what is not optimised needs functions that only numba provides.
OPTIMISATION = 3


class _Library(codegen.AOTCodeLibrary):
    """The lowered code of one function, and the libraries that it calls."""

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        self._finalized = True

    def whole(self) -> Any:
        """Return a module with this function and all functions that it calls."""
        module, seen, waiting = self._final_module, {self}, list(self._linking_libraries)
        while waiting:
            library = waiting.pop()
            if library in seen:
                continue
            seen.add(library)
            if isinstance(library, _Library):
                waiting.extend(library._linking_libraries)
                module.link_in(library._final_module, preserve=True)
            else:  # a function compiled by numba itself
                module.link_in(library._get_module_for_linking(), preserve=True)
        return module


class _Codegen(codegen.AOTCPUCodegen):
    """Code generator for libraries that are optimised only after linking."""

    _library_class = _Library

    def _customize_tm_options(self, options: dict[str, Any]) -> None:
        options.update(host().options(), opt=OPTIMISATION)

    def _customize_tm_features(self) -> str:
        return host().features


@lru_cache
def _codegen() -> _Codegen:
    """Return the code generator, which is made once."""
    return _Codegen("evac")


class _Context(cpu.CPUContext):
    """Target context without wrappers for Python; it supports numbers, tuples, ranges and mathematical functions."""

    # numba asks for the size of a type at each variable.
    get_abi_sizeof = lru_cache(cpu.CPUContext.get_abi_sizeof)

    def load_additional_registries(self) -> None:
        """Load the registries that kernels use, without linear algebra, random numbers, dictionaries and classes."""
        for name in ("core.optional", "cpython.builtins", "cpython.numbers", "cpython.rangeobj", "cpython.tupleobj"):
            import_module(f"numba.{name}")
        self.install_registry(mathimpl.registry)
        rtsys.initialize(self)

    def init(self) -> None:
        super().init()
        self._internal_codegen = _codegen()

    def get_function(self, fn: Any, sig: Any, _firstcall: bool = True) -> Any:
        """Also find functions compiled by numba itself: functions under ``numba.njit``, and NumPy functions."""
        try:
            return super().get_function(fn, sig, _firstcall)
        except NotImplementedError:
            known = cpu_target.target_context._defns.items()
            self._defns.update((key, overloads) for key, overloads in known if not self._defns[key].versions)
            return super().get_function(fn, sig, False)

    def get_executable(self, library: Any, fndesc: Any, env: Any) -> object:
        library.finalize()
        return object()  # serves as numba's key of the function


#: Registries of numba that kernels use.
_plain: dict[Any, Any] = {}

#: Signatures by function and types of arguments.
_resolved: dict[tuple[Any, Any], Any] = {}


class _Typing(typing.Context):
    """Typing context of kernels."""

    # Attributes for which numba would compile functions, mainly those of its arrays, are omitted, since registering
    # them takes as long as compiling a kernel. The type of each operation on the same types is searched for once.

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        if kws:
            return super().resolve_function_type(func, args, kws)
        if (func, args) not in _resolved:
            _resolved[func, args] = super().resolve_function_type(func, args, kws)
        return _resolved[func, args]

    def install_registry(self, registry: Any) -> None:
        """Install a registry of numba once, without such attributes."""
        if registry in _plain:
            return
        plain = _plain[registry] = templates.Registry()
        plain.functions, plain.globals = registry.functions, registry.globals
        overloaded = templates._OverloadAttributeTemplate
        plain.attributes = [attribute for attribute in registry.attributes if not issubclass(attribute, overloaded)]
        super().install_registry(plain)

    def load_additional_registries(self) -> None:
        """Load only the types of mathematical functions, as in `_Context`."""
        self.install_registry(mathdecl.registry)

    def resolve_value_type(self, value: Any) -> Any:
        if isinstance(value, type | type(max)) and value in BUILTINS:
            return BUILTINS[value]
        return super().resolve_value_type(value)


class _Target(TargetDescriptor):
    options = cpu.CPUTargetOptions

    typing_context = _Typing()
    target_context = _Context(typing_context, "cpu")


class _Pipeline(compiler.CompilerBase):
    """The compiler passes of numba without those for closures, generators, array expressions and reference counts."""

    def define_pipelines(self) -> list[PassManager]:
        stages = PassManager("evac kernel")
        for stage in (
            untyped_passes.TranslateByteCode,
            untyped_passes.FixupArgs,
            untyped_passes.IRProcessing,
            untyped_passes.ReconstructSSA,
            typed_passes.NopythonTypeInference,
            typed_passes.PreLowerStripPhis,
            typed_passes.NativeLowering,
            typed_passes.NoPythonBackend,
        ):
            stages.add_pass(stage, stage.__name__)
        stages.finalize()
        return [stages]


def _widened(kind: types.Type) -> types.Type:
    """Return the type in which a value is passed to a function: int64 for all integers, including constants."""
    kind = types.unliteral(kind)
    return types.int64 if isinstance(kind, types.Integer) else kind


class _Dispatcher(dispatcher.Dispatcher):
    """Dispatcher of one function for numba's front end."""

    targetdescr = _Target("cpu")
    _compiler: Any

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Type a call with all integers as int64, so that each function is compiled once for all integer types."""
        _, given = self._compiler.fold_argument_types(args, kws)
        return super().get_call_template([_widened(kind) for kind in given], {})

    def add_overload(self, result: Any) -> None:
        self.overloads[tuple(result.signature.args)] = result


_OPTIONS = {
    "nopython": True,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "error_model": "numpy",
    "_nrt": False,
}

_dispatchers: dict[Kernel, _Dispatcher] = {}


@typeof_impl.register(Kernel)
def _typeof_kernel(kernel: Kernel, context: Any) -> types.Type:
    if kernel not in _dispatchers:
        options = _OPTIONS | {"forceinline": kernel.is_inlined}
        _dispatchers[kernel] = _Dispatcher(kernel.function, {}, options, pipeline_class=_Pipeline)
    return types.Dispatcher(_dispatchers[kernel])


def compiled_functions() -> list[str]:
    """Return the names of the functions that have been compiled in this process."""
    return [kernel.label for kernel, compiling in _dispatchers.items() for _ in compiling.overloads]


@contextmanager
def _without_collections() -> Generator[None, None, None]:
    """Disable garbage collection, which would take a tenth of the time because of numba's many objects."""
    is_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if is_enabled:
            gc.enable()


@global_compiler_lock
@_without_collections()
def compile_entry(entry: Entry, symbol: str) -> bytes:
    """Compile a kernel; return its object code, in which it has the name `symbol`."""
    arguments = [type_of(kind) for _, kind in entry.signature[0]]
    compiling = numba.typeof(entry).dispatcher
    try:
        compiling.compile(tuple(arguments))
    except Exception as error:  # numba raises exceptions of many classes
        if isinstance(error, MemoryError):
            raise
        for part in kernels_in(entry):
            if isinstance(part, Entry) and part is not entry:
                compile_entry(part, f"{symbol}_part")  # raises if the mistake is there
        raise _refused(entry, error) from None
    result = compiling.overloads[tuple(arguments)]
    _check_result(entry, result.fndesc.restype)
    library = _codegen().create_library(symbol)
    library.add_ir_module(_wrapper(compiling.targetctx, result.fndesc, arguments, entry, symbol))
    library.add_linking_library(result.library)
    module = library.whole()
    for function in module.functions:
        if not function.is_declaration and function.name != symbol:
            function.linkage = "internal"
    for variable in module.global_variables:
        if not variable.is_declaration:
            variable.linkage = "internal"
    module.verify()
    passes, builder = library.codegen._module_pass_manager(opt=OPTIMISATION)
    passes.run(module, builder)
    _check_names(entry, module)
    return bytes(library.codegen._tm.emit_object(module))


def _check_names(entry: Entry, module: Any) -> None:
    """Refuse code that cannot be loaded, since LLVM ends the process that loads it."""
    declared = [function.name for function in module.functions if function.is_declaration]
    for name in declared:
        if not (name.startswith("llvm.") or name == NOTE_RAISED or llvm.address_of_symbol(name)):
            remedy = "use numbers, tuples and the functions of math, and unset variables that begin with NUMBA_"
            raise fault(f"kernel {entry.title}", f"needs {name}, which is not available to kernels", remedy, entry)


def _check_result(entry: Entry, returned: types.Type) -> None:
    """Refuse a kernel whose return type differs from its declaration."""
    wanted = entry.signature[1]
    given = list(returned) if isinstance(returned, types.BaseTuple) else [returned]
    if wanted and not (len(given) == len(wanted) and all(map(_fits, given, wanted))):
        raise fault(f"kernel {entry.title}", f"returns {returned}", f"return {', '.join(wanted)} in every case", entry)


def _fits(kind: types.Type, wanted: str) -> bool:
    """Return whether a type can be converted to the declared return type without loss."""
    return isinstance(kind, types.Integer | types.Boolean) or (wanted == "float64" and isinstance(kind, types.Float))


def _wrapper(context: Any, description: Any, arguments: list[Any], entry: Entry, symbol: str) -> ir.Module:
    """Return a module with a wrapper of plain numbers, which records an exception of the function and returns zeros."""
    module = context.create_module(symbol)
    inputs = [context.get_value_type(kind) for kind in arguments]
    returned = entry.signature[1]
    outputs = [context.get_value_type(getattr(types, kind)) for kind in returned]
    output = ir.VoidType() if not outputs else outputs[0] if len(outputs) == 1 else ir.LiteralStructType(outputs)
    function = ir.Function(module, ir.FunctionType(output, inputs), symbol)
    builder = ir.IRBuilder(function.append_basic_block())
    callee = context.declare_function(module, description)
    outcome, results = context.call_conv.call_function(
        builder, callee, description.restype, description.argtypes, list(function.args)
    )
    raised, done = function.append_basic_block("raised"), function.append_basic_block("done")
    builder.cbranch(outcome.is_error, raised, done)
    builder.position_at_end(raised)
    text = context.insert_const_string(module, entry.label)
    builder.call(ir.Function(module, ir.FunctionType(ir.VoidType(), [text.type]), NOTE_RAISED), [text])
    if outputs:
        builder.ret(ir.Constant(output, None))
    else:
        builder.ret_void()
    builder.position_at_end(done)
    if not outputs:
        builder.ret_void()
    elif len(outputs) == 1:
        builder.ret(context.cast(builder, results, description.restype, getattr(types, returned[0])))
    else:
        values = ir.Constant(output, ir.Undefined)
        for k, (kind, name) in enumerate(zip(description.restype, returned, strict=True)):
            value = context.cast(builder, builder.extract_value(results, k), kind, getattr(types, name))
            values = builder.insert_value(values, value, k)
        builder.ret(values)
    return module


# Errors, in one line each: the reason that numba states, and its place

_FRAMES = ("Failed in ", "During: ", "File ")  #: Beginnings of lines of numba's messages that name no reason.

#: Beginning of the reason if a kernel returns values of different types; numba names one of the lines by chance.
UNLIKE = "Can't unify return type"

#: Remedies for frequent reasons, by their beginnings, and for others.
_REMEDIES = {
    "Unsupported constraint encountered: raise": "kernels raise no exceptions, return a number instead",
    "Untyped global name": "decorate the functions that it calls with evac.jit.inner, and use numbers as constants",
    "NameError": "correct the name",
    UNLIKE: "return the same numbers in every case",
    "": "use only numbers, tuples, structs, arrays and math, see docs/plugins_contact.md, section 'Kernels'",
}


def _refused(entry: Entry, error: Exception) -> PluginError:
    """Return the error for a kernel that numba cannot compile, with the line of the kernel if it is known."""
    lines = [line.strip() for line in re.sub(r"\x1b\[\d*m", "", str(error)).splitlines()]
    reasons = [line for line in lines if line and not line.startswith(_FRAMES)]
    reason = " ".join(reasons[: 2 if reasons and reasons[0].endswith(":") else 1]) or type(error).__name__
    remedy = next(remedy for start, remedy in _REMEDIES.items() if reason.startswith(start))
    return fault(f"kernel {entry.title}", f"cannot be compiled: {reason}", remedy, _place(entry, lines, reason))


def _place(entry: Entry, lines: list[str], reason: str) -> tuple[str, int]:
    """Return file and line of the mistake: as stated by numba, or where the word that it names is used."""
    own = {kernel.function.__code__.co_filename for kernel in kernels_in(entry)}
    for line in lines if not reason.startswith(UNLIKE) else ():
        match = re.match(r'File "(.+)", line (\d+)', line)
        if match and (file := os.path.realpath(match[1])) in own:  # numba states paths relative to the current folder
            return file, int(match[2])
    code = entry.function.__code__
    word = re.search(r"name '(\w+)'|<built-in function (\w+)>", reason)
    uses = (use for use in dis.get_instructions(code) if word and use.argval in (word[1], word[2]))
    place = next((use.positions.lineno for use in uses if use.positions and use.positions.lineno), None)
    return code.co_filename, place or code.co_firstlineno
