"""What Numba compiles, kept in `worm3d.machine.cache.files`.

Numba's own cache is an index and numbered files, all of them pickles that are loaded unverified: a damaged one is a
traceback, or a segmentation fault, in every later process, and so is a full disc. It also keeps a function until its
own file changes, even if one that it calls has changed since. Here a function is one file, under a key of all that it
is made of, and bytes are unpickled only after they have been verified.

Of Numba's internals this takes the attribute `_cache` of compiled functions and what `numba.core.caching.FunctionCache`
does besides finding files: an entry's key, and the conversion of compiled code to what can be pickled.
"""

from __future__ import annotations

import hashlib
import inspect
import pickle
import platform
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.runtime.nrt import rtsys

from worm3d.machine.cache import files
from worm3d.machine.cache.locks import alone

_pickled: Any = numba.core.serialize.dumps
SUFFIX = ".function"
FOLDER = "compiled"


def keep(compiled: Any, version: Callable[[], str], missed: Callable[[], None] = lambda: None) -> Any:
    """Let a function of Numba's be kept on disk, and return it.

    Parameters
    ----------
    compiled : Dispatcher or CFunc
        Not compiled yet. Anything else, as Numba gives where NUMBA_DISABLE_JIT is set, is returned as it is.
    version : callable
        Digest of what the function is made of besides its own file (`sources_digest`).
    missed : callable
        Called before the function is compiled because it is not on disk.
    """
    if hasattr(compiled, "_cache"):
        compiled._cache = _Kept(compiled.__wrapped__, version, missed)
    return compiled


def sources_digest(root: Path, sources: Iterable[Path]) -> str:
    """Return a digest of sources, of where their package is, and of the programs that compile them."""
    programs = (numba.__version__, llvmlite.__version__, platform.python_version(), str(root))
    parts = [*map(str.encode, programs), *(path.read_bytes() for path in sorted(sources))]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


class _Locator(_CacheLocator):
    """Finds no folder: that is for `worm3d.machine.cache.files`."""

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Locator:
        return cls(py_file)

    def __init__(self, py_file: str) -> None:
        self._py_file = py_file  # Numba's warnings name it

    def get_cache_path(self) -> str:
        return str(files.folder(FOLDER))

    def ensure_cache_path(self) -> None:
        pass

    def get_source_stamp(self) -> str:
        return ""

    def get_disambiguator(self) -> str:
        return ""


class _Implementation(CompileResultCacheImpl):
    _locator_classes: Any = [_Locator]  # noqa: RUF012


class _Kept(FunctionCache):
    """The cache of one function."""

    _impl_class = _Implementation

    def __init__(self, function: Callable[..., Any], version: Callable[[], str], missed: Callable[[], None]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        self._cache_file: Any = _Entries(function, version)
        self._missed = missed
        self._alone = ExitStack()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what is kept, or None; what is missing is then compiled by this process alone, until it is saved."""
        self._alone.close()
        found = self._found(sig, target_context)
        if found is None:
            name = self._cache_file.name(self._index_key(sig, target_context.codegen()))  # type: ignore[no-untyped-call]
            self._alone.enter_context(alone(files.folder(FOLDER), name))
            found = self._found(sig, target_context)  # what another process has compiled meanwhile
        if found is None:
            self._missed()
        else:
            self._alone.close()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what has been compiled."""
        try:
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        finally:
            self._alone.close()

    def _found(self, sig: Any, target_context: Any) -> Any:
        try:
            # The method of the base class would first load all that compiling needs, which takes half a second. Code
            # that works on numbers and arrays calls nothing but Python, the C library and Numba's run time.
            rtsys.initialize(target_context)
            return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except Exception:  # verified, but not what this version of Numba and of its neighbours can use
            return None


class _Entries:
    """The entries of one function, in the place of Numba's index and data files."""

    def __init__(self, function: Callable[..., Any], version: Callable[[], str]) -> None:
        self._function, self._version = function, version

    def load(self, key: Any) -> Any:
        content = files.load(files.folder(FOLDER), self.name(key), SUFFIX)
        if content is None:
            return None
        kept, data = pickle.loads(content)  # written by us: `files.load` has verified it
        return data if kept == key else None

    def save(self, key: Any, data: Any) -> None:
        files.store(files.folder(FOLDER), self.name(key), _pickled((key, data)), SUFFIX)

    def name(self, key: Any) -> str:
        """Return the key of an entry, from the function, its sources and Numba's key: signature, processor, code."""
        source = Path(inspect.getfile(self._function))
        code = self._function.__code__
        parts = (self._version(), str(source), _stamp(source), self._function.__qualname__, str(code.co_firstlineno))
        return hashlib.sha256("\0".join((*parts, repr(key))).encode()).hexdigest()


def _stamp(source: Path) -> str:
    try:
        return hashlib.sha256(source.read_bytes()).hexdigest()
    except OSError:
        return ""  # a prompt or a notebook: the code is in Numba's key
