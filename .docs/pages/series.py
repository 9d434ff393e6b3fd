"""The page with all recorded series, from the declarations of the series and from short runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from pages.text import code, page, prose, table
from scenes.records.record import Record
from worm3d.physics.actuator_names import ACTUATORS
from worm3d.physics.hysteresis import HYSTERESES
from worm3d.physics.loads import LOADS
from worm3d.recorded.energy import Energy
from worm3d.recorded.series import Recorded, Series, Steps, series_of
from worm3d.values.variable import Variable

PAGE_INTRODUCTION = """
A series is a quantity that a run records. In Python a series is an attribute of `worm3d.Result`, such as `result.com`.
The terms of the energy ledger are attributes of `result.energy`. In the file `result.nc` each series is a variable with
the same name. The program makes this page from the declarations of the series.

T is the number of recorded instants, S is the number of time steps, and N is the number of segments. Segment and joint
0 are at the tail. The dimension `axis` is x, y, z. The dimension `chamber` is left, right. The dimension `point` has
the six apexes in the order L-below, L-above, L-outward, R-below, R-above, R-outward, and then the tail face and the
head face. Between two rows, a quantity that adds up, such as `slip`, is the sum over the steps since the previous row.
""".strip()

STATES = """
An actuator, a friction of the joints or a load may have states. `result.actuator_states` has a series for each state.
In `result.nc` the name has the prefix `actuator_`. A state of an actuator of the chambers has a number for each
chamber, shape (T, N, 2). A state of an actuator of the hinges has the prefix `hinge_` and the shape (T, N-1). A state
of a load has the prefix `load_` and the shape (T,). A worm with a learned segment law also has `pressure` [Pa] or
`cable` [N], shape (T, N, 2); in Python it is `result.chamber_input`.
""".strip()

OTHERS = {
    "worm_control": "A scene with a controller also records the decisions of the controller.",
    "load_frame": "A load frame records the cable and one segment.",
    "planar_linkage": "The planar linkage records joints and apexes in the plane.",
    "planar_published": "The program of the paper records its nodes.",
}
"""Models that have other series than a 3D worm, with a sentence for each."""


def series(records: Mapping[str, Record]) -> str:
    """Return the page; `records` has a short run of each model, by the name of the model."""
    blocks = [PAGE_INTRODUCTION, "## The worm at recorded instants", _declared(Recorded), "## The energy ledger"]
    blocks += [_declared(Energy), "## Time steps", _declared(Steps), "## States of the parts", STATES, _states()]
    worm = {variable.name for variable in records["worm"].variables}
    for model, said in OTHERS.items():
        new = [each for each in records[model].variables if model != "worm_control" or each.name not in worm]
        blocks += [f"## Scenes of {code(model)}", said, _variables(new)]
    return page("Recorded series", *blocks)


def _declared(holder: type) -> str:
    return table(["series", "unit", "shape", "meaning"], map(_row, *zip(*series_of(holder).items(), strict=True)))


def _row(name: str, known: Series) -> list[str]:
    shape = known.shape_text if known.dims else "number"
    return [code(name), code(known.unit), shape, prose(known.meaning)]


def _states() -> str:
    rows = [
        [code(name), code(state), code(unit)]
        for registry in (ACTUATORS, HYSTERESES, LOADS)
        for name, part in registry.items()
        for state, unit in part.states.items()
    ]
    return table(["part", "state", "unit"], rows)


def _variables(variables: Iterable[Variable]) -> str:
    rows = ([code(v.name), code(v.units), f"({', '.join(v.dims)})", prose(v.long_name)] for v in variables)
    return table(["variable", "unit", "dimensions", "meaning"], rows)
