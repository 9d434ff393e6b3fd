"""Equilibria of a segment over length and input: paths between states, the choice of states, and the mesh error.

`reached` follows a straight path in the plane of length and input, with steps that are halved where Newton's method
fails. At a snap-through, two other ways remain. The first has the length of the arc as parameter, which passes turning
points of length and input. The second has the enclosed volume as parameter, at held length. `sweep` chooses each state
as far as possible from all states before it, in the plane of length and input, since such states train a law better
than random states.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from worm3d.fem.axisymmetric import Constraint, State, Wall, constrained, followed, rest, solved, tangent_of
from worm3d.values.arrays import FloatArray

LARGEST_STEP = 0.125
"""Largest step of a path, as a fraction of the ranges of length and input. Larger steps may jump to another branch of
solutions; half as large steps double the time and change no state of the shipped barrel."""
LEAST_STEP = LARGEST_STEP / 64.0
"""Smallest step of a path before another way is tried. A smooth path needs no step below an eighth of the largest."""
ARC_STEPS = 120
"""Largest number of steps along the arc. A snap-through takes 20 to 80 steps. Where the wall folds many times, more
steps do not arrive either."""
ARC_STEP, LEAST_ARC_STEP = 0.02, 1e-4
"""First and smallest step along the arc; 1 is the whole path, or a mean displacement of the rest length."""
VOLUME_STEP, LEAST_VOLUME_STEP = 0.05, 0.002
"""First and smallest step of the volume, as a fraction of the volume. The snap-through of a balloon spans some 50 such
steps."""
VOLUME_STEPS = 120
"""Largest number of steps of the volume."""
FREE_STATES = 11
"""Number of states without axial force, at equal steps of the input, with which each sweep begins."""
SHORTENING, LENGTHENING = 0.06, 0.02
"""Margins of the domain below the free length at each input, and above the rest length, relative to the rest length. A
wall that is shortened further folds sharply at the plate: with 0.1, a law from 100 states misses the forces of the
shipped barrel by 0.6 % in place of 0.1 %. Threads that hardly stretch make larger lengths very stiff."""
SPREAD_POWER = 0.7
"""Power below 1 that makes states denser at small inputs and near the free length, where worms crawl and segments
change most. For the shipped barrel, straight distances with laws from 100 states are within 1.5 % of finite elements,
and within 5.4 % with equal spacing; with 0.5, 100 states are too few for large lengths."""
CANDIDATES = 61
"""Number of lengths and of inputs from which states are chosen."""
TRIES_PER_STATE = 2
"""Largest number of tried states per requested stable state. A domain that is more than half unstable is an error."""
CHECKED_STATES = 5
"""Number of states that are solved on a second mesh for the mesh error."""


@dataclass(frozen=True, eq=False)
class Domain:
    """Lengths [m] and inputs [Pa] or [N] of a table."""

    length: tuple[float, float]
    input: tuple[float, float]
    least: tuple[FloatArray, FloatArray] | None = None
    """Inputs, ascending, and the least length at each input; None for a rectangle."""

    def scaled(self, length: FloatArray | float, value: FloatArray | float) -> FloatArray:
        """Return lengths and inputs as fractions of their ranges, shape (..., 2)."""
        low = np.array([self.length[0], self.input[0]])
        size = np.array([self.length[1], self.input[1]]) - low
        scaled: FloatArray = (np.stack(np.broadcast_arrays(length, value), axis=-1) - low) / size
        return scaled

    def spread(self, length: FloatArray | float, value: FloatArray | float) -> FloatArray:
        """Return coordinates from 0 to 1 that spread the states of a table evenly, shape (..., 2).

        They are powers, `SPREAD_POWER`, of the input and of the length above the least length, as fractions of their
        ranges.
        """
        shortest = self.shortest(value)
        above = (length - shortest) / (self.length[1] - shortest)
        fraction = self.scaled(length, value)[..., 1]
        fractions: FloatArray = np.clip(np.stack(np.broadcast_arrays(above, fraction), axis=-1), 0.0, 1.0)
        return fractions**SPREAD_POWER

    def grid(self) -> FloatArray:
        """Return lengths and inputs from which states are chosen, shape (K, 2)."""
        ranges = [np.linspace(low, high, CANDIDATES) for low, high in (self.length, self.input)]
        points = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, 2)
        return points[points[:, 0] >= self.shortest(points[:, 1])]

    def shortest(self, value: FloatArray | float) -> FloatArray:
        """Return the least length [m] at inputs."""
        return np.asarray(np.interp(value, *self.least) if self.least else np.full(np.shape(value), self.length[0]))

    def corners(self) -> FloatArray:
        """Return the four corners, shape (4, 2)."""
        return np.array([[length, value] for value in self.input for length in (self.shortest(value), self.length[1])])


@dataclass(frozen=True)
class Reached:
    """Result of a path."""

    state: State
    """Last equilibrium: at the target, or where the path stopped."""
    arrived: bool
    way: str
    """Way that found the last equilibrium: "steps", "arc length" or "volume"."""


@dataclass(frozen=True)
class Progress:
    """Progress of a sweep, for the line on the terminal."""

    states: tuple[State, ...]
    stopped: tuple[str, ...]
    """A sentence for each target that no way has reached."""

    @property
    def stable(self) -> int:
        """Number of stable states."""
        return sum(state.stable for state in self.states)


def reached(start: State, length: float, value: float, domain: Domain) -> Reached:
    """Return the equilibrium at a length [m] and an input, along a path from an equilibrium.

    Parameters
    ----------
    start : State
    length, value : float
        Target.
    domain : Domain
        Ranges that scale the steps.
    """
    found = by_steps(start, length, value, domain)
    if found.arrived:
        return found
    for way in (by_arc_length, by_volume):
        other = way(found.state, length, value)
        if other is not None:
            return Reached(other, True, way.__name__.removeprefix("by_").replace("_", " "))
    return found


def by_steps(start: State, length: float, value: float, domain: Domain) -> Reached:
    """Follow a straight path with steps that are halved on failure and doubled after success."""
    ends = domain.scaled(np.array([start.length, length]), np.array([start.input, value]))
    largest = LARGEST_STEP / max(float(np.linalg.norm(ends[1] - ends[0])), LARGEST_STEP)

    def step_to(state: State, t: float) -> State | None:
        along, across = ((a + t * (b - a) if t < 1.0 else b) for a, b in ((start.length, length), (start.input, value)))
        return solved(state, along, across)

    state, t = followed(step_to, start, largest, largest * LEAST_STEP / LARGEST_STEP)
    return Reached(state, t == 1.0, "steps")


def by_arc_length(start: State, length: float, value: float) -> State | None:
    """Follow the curve of equilibria through turning points, with the length of the arc as parameter.

    The parameter t of the straight path to the target may decrease on the way. The method ends at t = 1.
    """
    direction = (length - start.length, value - start.input)
    state, t, step = start, 0.0, ARC_STEP
    before = _Tangent.at(state, direction, None)
    for _ in range(ARC_STEPS):
        if before is None or step < LEAST_ARC_STEP:
            return None
        found, t_found = _arc_step(state, t, direction, before, step)
        if found is None:
            step /= 2.0
            continue
        if t_found >= 1.0:
            return solved(found, length, value)
        state, t, step = found, t_found, min(1.5 * step, 4.0 * ARC_STEP)
        before = _Tangent.at(state, direction, before)
    return None


@dataclass(frozen=True)
class _Tangent:
    """Unit tangent of a curve of equilibria: free unknowns, and the parameter t."""

    dx: FloatArray
    dt: float
    weight: FloatArray

    @classmethod
    def at(cls, state: State, direction: tuple[float, float], before: _Tangent | None) -> _Tangent | None:
        """Return the tangent that goes on in the direction of the tangent before, at first towards greater t."""
        dx = tangent_of(state, direction)
        if dx is None:
            return None
        moves = state.wall.free < state.wall.displacements
        weight = moves / (moves.sum() * state.wall.segment.rest_length**2)
        size = float(np.sqrt((weight * dx) @ dx + 1.0))
        found = cls(dx / size, 1.0 / size, weight)
        forward = before is None or (weight * found.dx) @ before.dx + found.dt * before.dt > 0.0
        return found if forward else cls(-found.dx, -found.dt, weight)


def _arc_step(
    state: State, t: float, direction: tuple[float, float], tangent: _Tangent, step: float
) -> tuple[State | None, float]:
    free, axis = state.wall.free, int(abs(direction[1]) > 0.0)
    begin = (state.length, state.input)[axis]

    def moved(found: State) -> float:
        return ((found.length, found.input)[axis] - begin) / direction[axis]

    def constraint(found: State) -> tuple[float, FloatArray, float]:
        row = tangent.weight * tangent.dx
        return row @ (found.x[free] - state.x[free]) + tangent.dt * moved(found) - step, row, tangent.dt

    dt = step * tangent.dt
    guess = state.moved(step * tangent.dx, state.length + dt * direction[0], state.input + dt * direction[1])
    found = constrained(guess, direction, constraint)
    return found, t if found is None else t + moved(found)


def by_volume(start: State, length: float, value: float) -> State | None:
    """Go to the length at held pressure, then change the volume at held length until the pressure is reached.

    The way does not exist for a cable, whose tension does not change the shape at held length.
    """
    state = start if start.length == length else solved(start, length, start.input)
    if state is None or state.is_cable:
        return None
    unit, sign, step = max(abs(value), abs(start.input)), np.sign(value - state.input), VOLUME_STEP
    for _ in range(VOLUME_STEPS):
        target = state.volume * (1.0 + sign * step)
        found = constrained(state, (0.0, unit), held_volume(target, state.volume))
        if found is not None and sign * (found.input - value) >= 0.0:
            return solved(found, length, value)
        if found is None and step <= LEAST_VOLUME_STEP:
            return None
        state, step = (state, step / 2.0) if found is None else (found, min(1.5 * step, VOLUME_STEP))
    return None


def held_volume(volume: float, unit: float) -> Constraint:
    """Return the constraint that holds the enclosed volume [m^3], in units of a volume."""
    return lambda state: ((state.volume - volume) / unit, state.parts[4][state.wall.free] / unit, 0.0)


def free_length(state: State, value: float) -> State | None:
    """Return the state without axial force at an input, from a close state without axial force."""
    close = solved(state, state.length, value)
    unit = state.wall.energy_unit / state.wall.segment.rest_length
    if close is None:
        return None

    def constraint(found: State) -> tuple[float, FloatArray, float]:
        row, by_length = found.force_gradient
        return found.force / unit, row / unit, by_length * found.wall.segment.rest_length / unit

    return constrained(close, (state.wall.segment.rest_length, 0.0), constraint)


def free_states(wall: Wall) -> list[State]:
    """Return the states without axial force, from rest to the greatest input, shape (`FREE_STATES`,) if all exist."""
    low, high = wall.segment.load.values
    states = [rest(wall)]
    for value in np.linspace(0.0, high, 2 * (FREE_STATES - 1) + 1)[1:]:
        found = free_length(states[-1], float(value))
        if found is None:
            break
        states.append(found)
    return [state for state in states[::2] if state.input >= low]


def domain_of(wall: Wall, free: list[State]) -> Domain:
    """Return the domain of the table: the rectangle of the description, or else the lengths about the free lengths."""
    load, rest_length = wall.segment.load, wall.segment.rest_length
    if load.length_m is not None:
        return Domain(load.length_m, load.values)
    lengths = np.array([state.length for state in free])
    least = lengths - SHORTENING * rest_length
    longest = max(rest_length, float(lengths.max())) + LENGTHENING * rest_length
    return Domain((float(least.min()), longest), load.values, (np.array([state.input for state in free]), least))


def sweep(wall: Wall, count: int) -> Iterator[Progress]:
    """Yield the states after each state, until `count` states are stable.

    The first states are the states without axial force and the corners of the domain. Each further state is as far as
    possible from all before it.

    Raises
    ------
    ValueError
        Fewer than `count` states are stable among `TRIES_PER_STATE` times as many.
    """
    free = free_states(wall)
    domain = domain_of(wall, free)
    progress = Progress(tuple(free[:count]), ())
    tried = [domain.spread(state.length, state.input) for state in free]
    grid, corners = domain.grid(), list(domain.corners())
    yield progress
    while progress.stable < count:
        if len(tried) >= TRIES_PER_STATE * count + FREE_STATES:
            raise ValueError(
                f"only {progress.stable} of {len(tried)} states are stable, must be {count}: the domain of lengths "
                f"{domain.length} m and inputs {domain.input} is mostly crumpled; narrow load.length_m, or raise the "
                "least pressure"
            )
        length, value = corners.pop() if corners else farthest(domain, grid, tried)
        tried.append(domain.spread(length, value))
        progress = _with_state(progress, (float(length), float(value)), domain, rest(wall))
        yield progress


def farthest(domain: Domain, grid: FloatArray, tried: list[FloatArray]) -> FloatArray:
    """Return the point of a grid, shape (K, 2), that is farthest from all tried points, which are from `spread`."""
    spread = domain.spread(grid[:, 0], grid[:, 1])
    distances = np.min([((spread - each) ** 2).sum(axis=1) for each in tried], axis=0)
    found: FloatArray = grid[np.argmax(distances)]
    return found


def _with_state(progress: Progress, target: tuple[float, float], domain: Domain, fallback: State) -> Progress:
    """Return the progress with the state at a target, reached from the nearest stable state."""
    starts = [state for state in progress.states if state.stable] or [fallback]
    goal = domain.scaled(*target)
    start = min(starts, key=lambda state: float(np.linalg.norm(domain.scaled(state.length, state.input) - goal)))
    found = reached(start, *target, domain)
    if found.arrived:
        return replace(progress, states=(*progress.states, found.state))
    where = f"stopped at {found.state.length * 1e3:.2f} mm and {found.state.input:.6g}"
    aim = f"on the way to {target[0] * 1e3:.2f} mm and {target[1]:.6g}"
    return replace(progress, stopped=(*progress.stopped, f"{where} {aim}"))


def mesh_error(states: tuple[State, ...], finer: Wall, watch: Callable[[int], None] = lambda done: None) -> float:
    """Return the rms difference of the force on a second mesh, relative to the rms force of the table; NaN if none.

    Some stable states, spread over the table, are solved on both meshes.

    Parameters
    ----------
    states : tuple of State
    finer : Wall
        Model of the same segment on a finer mesh.
    watch : callable
        Called with the number of finished states after each state.
    """
    stable = [state for state in states if state.stable]
    rms = float(np.sqrt(np.mean([state.force**2 for state in stable])))
    chosen = [stable[n] for n in np.unique(np.linspace(0, len(stable) - 1, CHECKED_STATES + 1).astype(int))[1:]]
    lengths = [state.length for state in stable]
    domain = Domain((min(lengths), max(lengths)), finer.segment.load.values)
    differences = []
    for done, state in enumerate(chosen, start=1):
        found = on_mesh(state, finer) or reached(rest(finer), state.length, state.input, domain).state
        if found.length == state.length and found.input == state.input:  # or else the path has stopped on the way
            differences.append(found.force - state.force)
        watch(done)
    return float(np.sqrt(np.mean(np.square(differences)))) / rms if differences else np.nan


def on_mesh(state: State, wall: Wall) -> State | None:
    """Return the equilibrium on another mesh, from the interpolated displacements and multipliers of a state."""
    x = np.zeros(wall.size)
    for mine, other in zip(state.wall.fields, wall.fields, strict=True):
        x[other.dofs] = mine.at(state.x, other.places)
    guess = State(wall, x, state.length, state.input)
    return solved(guess, state.length, state.input)
