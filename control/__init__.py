"""Gaits, sensing, estimation and control of worm robots (worm3d's package, not the distribution python-control)."""

import importlib
import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

DISTRIBUTION = "worm3d"
"""Distinguishes this package from the package of python-control, which has the same import name."""
_MOVED = {
    "control.estimator": "control.estimation.estimator",
    "control.generator": "control.gaits.steering",
    "control.identified": "control.identification.identified",
    "control.measurement": "control.sensing.sensors",
    "control.metrics": "control.tracking.metrics",
    "control.mpc": "control.planning.mpc",
    "control.paths": "control.tracking.paths",
    "control.pipe_gait": "control.gaits.patterns",
    "control.references": "control.tracking.references",
    "control.sensors": "control.sensing.sensors",
    "control.steering": "control.gaits.steering",
}
"""Former name of each module that users imported; the former name still works."""


class _FormerNames(MetaPathFinder, Loader):
    """Imports a module under its former name."""

    def find_spec(self, name: str, _path: Sequence[str] | None, _target: ModuleType | None = None) -> ModuleSpec | None:
        return ModuleSpec(name, self) if name in _MOVED else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = importlib.import_module(_MOVED[spec.name])
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Restore the specification of the module, which has been executed under the new name."""
        assert module.__spec__ is not None
        module.__spec__ = module.__spec__.loader_state


sys.meta_path.append(_FormerNames())
