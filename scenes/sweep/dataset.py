"""The function `worm3d.sweep`, which runs a sweep from Python and returns a data set."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenes.language.errors import MissingPartError, SceneError
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
    """Run a scene many times with varied keys, and return the results of all cases.

    Parameters
    ----------
    scene : str or Path
        Name of a shipped scene, or path of a TOML file.
    vary : mapping, optional
        Values of each varied key, by key, for example {"gait.period_s": [1.0, 2.0]}. The values are a sequence, or a
        text in the format of the command line, such as "1:3:5" (five values from 1 to 3), "1:100:5:log" (five values
        with equal ratios), or "1:3" (a range for `random`). Several keys make a grid. The default is the section
        [sweep] of the scene.
    random : int, optional
        Number of random cases.
    cases : sequence of mappings, or a CSV file, optional
        List of cases. Each case has values by key, and all cases have the same keys.
    overrides : iterable of str
        Items `section.key=value` for all cases.
    workers : int, optional
        Number of processes to start. By default, the cases run one after the other in the current process.
    scheduler : str, optional
        Address of a Dask scheduler whose workers run the cases.
    bind : str
        Network address where the scheduler for `workers` listens.
    case_limit_s : float, optional
        Time limit of a case [s], counted from the first step. A case that exceeds the limit fails. The default is the
        limit in the section [sweep], or an hour.
    out : str or Path, optional
        Folder for the cases and the outputs of the sweep, as in `worm3d sweep`. If the folder contains the sweep
        already, only missing cases are run. By default, nothing is stored.
    results : bool
        Whether the whole record of each case is stored, as by `worm3d run`.
    retry_failed : bool
        Whether cases in the folder that failed are run again.

    Returns
    -------
    xarray.Dataset
        The variables are the entries of the summary, `status`, `reason` and `seed`. In failed cases the entries of the
        summary are NaN. The dimensions are the varied keys. Random or listed cases have the dimension `case`, or
        `sample` if there are other dimensions.

    Raises
    ------
    SceneError
        If there are mistakes in the scene or the varied keys, with one line for each mistake, or if the folder cannot
        be used.
    MissingPartError
        If xarray is not installed.
    """
    try:
        import xarray
    except ImportError as error:
        raise MissingPartError("worm3d.sweep: xarray is not installed; pip install 'worm3d[xarray]'") from error
    if not (vary is None or isinstance(vary, Mapping)):
        raise SceneError(f"vary: got {vary!r:.60}, must be a mapping from keys to values; fixed keys are `overrides`")
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
