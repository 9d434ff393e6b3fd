"""`worm3d.sweep`: a sweep from Python, as a data set."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenes.language.errors import MissingPartError
from scenes.records import folder as folders
from scenes.sweep.engine import Sweep, chosen, require_place
from scenes.sweep.executors import LOOPBACK
from scenes.sweep.limit import limit_of
from scenes.sweep.outputs import DATASET, write_outputs
from scenes.sweep.plan import Source, planned
from scenes.sweep.vary import cases_of
from worm3d.values.spelling import spelled

if TYPE_CHECKING:
    import xarray


@spelled
def sweep(
    scene: str | Path,
    vary: Mapping[str, Any] | None = None,
    random: int | None = None,
    cases: Sequence[Mapping[str, Any]] | str | Path | None = None,
    overrides: Iterable[str] = (),
    workers: int | None = None,
    scheduler: str | None = None,
    bind: str = LOOPBACK,
    case_limit_s: float | None = None,
    out: str | Path | None = None,
    results: bool = False,
    retry_failed: bool = False,
) -> xarray.Dataset:
    """Run a scene many times, some of its keys varied, and return what all cases came to.

    Parameters
    ----------
    scene : str or Path
        Name of a shipped scene, or a TOML file.
    vary : mapping, optional
        Values by key of the scene: a sequence, or a text as on the command line, such as "1:3:5" (five values from 1 to
        3), "1:100:5:log", or with `random` "1:3" to draw from. Several sequences make a grid. Left out: as the scene's
        section [sweep] says.
    random : int, optional
        Number of cases to draw.
    cases : sequence of mappings, or a CSV file, optional
        Cases one by one: values by key, the same keys in each.
    overrides : iterable of str
        `section.key=value` each, for all cases.
    workers : int, optional
        Number of processes; left out, the cases run one after the other in this one.
    scheduler : str, optional
        Address of a Dask scheduler whose workers run the cases.
    bind : str
        Address on which the scheduler of `workers` listens.
    case_limit_s : float, optional
        Longest time of a case from its first step on [s]; one that takes longer fails. Left out: as the section [sweep]
        says, or an hour.
    out : str or Path, optional
        Folder of the cases and of what they show together, as `worm3d sweep` writes it; with the same folder only
        missing cases are run. Left out: nothing is kept.
    results : bool
        Whether whole records are kept, as `worm3d run` writes them.
    retry_failed : bool
        Whether cases are run again that failed before.

    Returns
    -------
    xarray.Dataset
        Dimensions are the varied keys, and `case` (or `sample`, beside others) of drawn or listed cases; variables are
        the figures of the summary, `status`, `reason` and `seed`. Figures of cases that failed are NaN.

    Raises
    ------
    SceneError
        A mistake in the scene or the varied keys, with a line for each; a folder that cannot be used.
    MissingPartError
        xarray is not installed.
    """
    try:
        import xarray
    except ImportError as error:
        raise MissingPartError("worm3d.sweep: xarray is not installed; pip install 'worm3d[xarray]'") from error
    executor = chosen(workers, scheduler, bind)
    listed = cases_of(Path(cases)) if isinstance(cases, str | Path) else cases or ()
    plan = planned(Source.of(scene, overrides), vary, random=random, listed=listed)
    with tempfile.TemporaryDirectory(prefix="worm3d-") as scratch:
        folder = Path(scratch if out is None else out)
        require_place(folder, force=False)
        with folders.locked(folders.made(folder)):
            job = Sweep(plan, folder, results, limit_of(plan.base.sweep, case_limit_s))
            job.run(executor, retry_failed=retry_failed)
            write_outputs(folder, plan.base, plan.design, job.ended())
            return xarray.load_dataset(folder / DATASET)
