"""Kernels of the loads of a worm, generated from `worm3d.physics.load.Load.respond`. All loads are one instance."""

from __future__ import annotations

from typing import Any

import casadi as ca

from worm3d.physics.expressions import answer, scalar
from worm3d.physics.kernels.layout import Layout, once
from worm3d.physics.load import Load, LoadStep
from worm3d.values.parameters import parameters_of

Kind = type[Load]

SHARED_INPUTS = {"dt": 1, "span": 1, "ratio": 1, "lands": 1, "gravity": 3, "stiffness": 1, "damping": 1, "touches": 1}
"""Number of rows of each input that all loads share."""
INPUTS_PER_LOAD = {"x": 3, "past": 6, "velocity": 6, "tangent": 3, "normal": 3, "regime": 1, "regime_n": 1}
"""Number of rows of the inputs of each load. After these inputs of all loads, the states and parameters follow."""
STORED_LOAD_TERMS, LOST_LOAD_TERMS = (
    ("kinetic", "elastic", "potential", "anchor"),
    ("friction_loss", "viscous_loss", "impact"),
)
LEDGER_TERMS = ("work_external", *STORED_LOAD_TERMS, *LOST_LOAD_TERMS, "numerical_loss")


@once
def layout(*kinds: Kind) -> Layout:
    """Return the layout of the inputs. It has no rows if there are no loads."""
    if not kinds:
        return Layout({})
    states = [f"{k}_{name}_n" for k, kind in enumerate(kinds) for name in kind.states]
    numbers = [f"{k}_{name}" for k, kind in enumerate(kinds) for name in parameters_of(kind)]
    own = {name: size * len(kinds) for name, size in INPUTS_PER_LOAD.items()}
    return Layout({**SHARED_INPUTS, **own, **dict.fromkeys([*states, *numbers], 1)})


def kept(*kinds: Kind) -> int:
    """Return the number of values that the loads keep between steps: the regimes of all loads, then their states."""
    return sum(1 + len(kind.states) for kind in kinds)


@once
def _steps(*kinds: Kind) -> list[LoadStep]:
    s, steps = layout(*kinds).symbols, []
    for k, kind in enumerate(kinds):
        given: dict[str, Any] = {name: s[name] for name in SHARED_INPUTS}
        given |= {name: s[name][size * k : size * (k + 1)] for name, size in INPUTS_PER_LOAD.items()}
        given["normal"] *= given.pop("touches")
        given |= {name: s[f"{k}_{name}"] for name in [*(f"{state}_n" for state in kind.states), *parameters_of(kind)]}
        steps.append(answer(kind, "respond", given))
    return steps


def _potentials(kinds: tuple[Kind, ...]) -> tuple[list[ca.SX], list[ca.SX]]:
    """Return the potentials of all loads, and the positions of the loads' joints."""
    x = ca.vertsplit(layout(*kinds).symbols["x"], 3)
    return [
        scalar(f"{kind.__name__}.potential", step.potential) for kind, step in zip(kinds, _steps(*kinds), strict=True)
    ], x


def _gradient(kinds: tuple[Kind, ...]) -> dict[str, Any]:
    potentials, x = _potentials(kinds)
    return {"phi": sum(potentials), "gradient": [ca.gradient(phi, at) for phi, at in zip(potentials, x, strict=True)]}


def gradient(*kinds: Kind) -> ca.Function | None:
    """Return the potential of all loads and its gradient (3 for each load); None if there are no loads."""
    return layout(*kinds).function("load_gradient", _gradient(kinds)) if kinds else None


def hessian(*kinds: Kind) -> ca.Function | None:
    """Return the outputs of `gradient`, and the Hessian (9 for each load)."""
    if not kinds:
        return None
    blocks = [ca.hessian(phi, at)[0] for phi, at in zip(*_potentials(kinds), strict=True)]
    return layout(*kinds).function("load_hessian", {**_gradient(kinds), "hessian": blocks})


def turn(*kinds: Kind) -> ca.Function | None:
    """Return the next regime of each load; None if there are no loads."""
    if not kinds:
        return None
    return layout(*kinds).function("load_turn", {"regime": [ca.SX(step.regime) for step in _steps(*kinds)]})


def after(*kinds: Kind) -> ca.Function | None:
    """Return the terms of the energy ledger, in the order of `LEDGER_TERMS`, and the values that `kept` counts."""
    if not kinds:
        return None
    past = ca.vertsplit(layout(*kinds).symbols["past"], 6)
    terms, states = ca.SX.zeros(len(LEDGER_TERMS)), []
    for kind, step, phi, x, before in zip(kinds, _steps(*kinds), *_potentials(kinds), past, strict=True):
        terms += _terms(kind, step, ca.dot(ca.gradient(phi, x), x - before[:3]))
        states += [scalar(f"{kind.__name__}.{name}", step.states[name]) for name in kind.states]
    regimes = [ca.SX(step.regime) for step in _steps(*kinds)]
    return layout(*kinds).function("load_after", {"terms": terms, "kept": [*regimes, *states]})


def _terms(kind: Kind, step: LoadStep, done: ca.SX) -> ca.SX:
    """Return the terms of a load. `done` is the work of the joint against the load, to first order [J]."""
    if unknown := set(step.terms) - set(LEDGER_TERMS[:-1]):
        raise ValueError(f"{kind.__name__}.respond: got the term {unknown.pop()!r}, must be of {LEDGER_TERMS[:-1]}")
    known = {name: scalar(f"{kind.__name__}.{name}", value) for name, value in step.terms.items()}
    of = [known.get(name, ca.SX(0.0)) for name in LEDGER_TERMS[:-1]]
    return ca.vertcat(*of, of[0] + done - sum(of[1:]))
