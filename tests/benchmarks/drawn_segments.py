"""Errors of `worm3d law` on held-out states of segments that are drawn at random (extra `fem`).

    python tests/benchmarks/drawn_segments.py [SEEDS...] [--folder DIR]

Each seed gives a segment from the ranges in `drawn`, and a table of 100 states. Descriptions and tables stay in the
folder, and the next run reads these tables. The program prints Markdown.
"""

from __future__ import annotations

from pathlib import Path
from time import perf_counter
from typing import Annotated

import numpy as np
import typer

from scenes.language.errors import SceneError
from scenes.records.text import markdown_table
from scenes.studies.fem import command as fem
from scenes.studies.law import table as tables
from scenes.studies.law.law import make
from scenes.studies.law.prepared import prepared

TITLES = ("segment", "force", "band", "radius", "volume", "time of new table and law")


def drawn(seed: int) -> tuple[str, str]:
    """Return the description of a segment in TOML, and a summary in words."""
    rng = np.random.default_rng(seed)
    length, plate, wall = rng.uniform(0.06, 0.15), rng.uniform(0.012, 0.025), rng.uniform(1e-3, 2.5e-3)
    middle, shear = plate * rng.uniform(1.0, 2.2), rng.uniform(40e3, 150e3)
    angle, softening = rng.uniform(0.0, 20.0), rng.uniform(0.0, 0.03)
    most = rng.uniform(1.2, 2.6) * shear * wall / middle
    points = [[0.0, middle], [0.2, 0.8 * middle + 0.2 * plate], [0.4, 0.25 * middle + 0.75 * plate], [0.5, plate]]
    z, radius = (np.array(points) * [length, 1.0]).T.tolist()
    profile = rng.choice([
        f'"barrel"\nlength_m = {length}\nplate_radius_m = {plate}\nmiddle_radius_m = {middle}',
        f'"cylinder"\nlength_m = {length}\nradius_m = {middle}',
        f'"points"\nz_m = {z}\nradius_m = {radius}',
    ])  # fmt: skip
    rubber = rng.choice([
        f'"neo-Hookean"\nshear_modulus_Pa = {shear}',
        f'"Yeoh"\nc1_Pa = {shear / 2.0}\nc3_Pa = {softening * shear}',
        f'"Ogden"\nmoduli_Pa = [{shear}, {softening * shear}]\nexponents = [1.7, 4.5]',
    ])  # fmt: skip
    fibres = f"angle_deg = {angle}\nstiffness_N = {rng.uniform(20.0, 50.0)}\nper_m = {rng.uniform(150.0, 350.0)}"
    text = f"[profile]\nkind = {profile}\n[wall]\nthickness_m = {wall}\n[rubber]\nkind = {rubber}\n"
    text += f"[[fibres]]\n{fibres}\n[load]\npressure_Pa = [0.0, {most}]\n"
    kinds = " of ".join(str(each).split('"')[1] for each in (profile, rubber))
    sizes = f"{1e3 * length:.0f} mm, radius {1e3 * middle:.0f} mm, wall {1e3 * wall:.1f} mm"
    return text, f"{seed}: {kinds}, {sizes}, threads at {angle:.0f}°, {most / 1e3:.1f} kPa"


def row(seed: int, folder: Path) -> tuple[str, ...]:
    """Return the row of a segment; a refusal is shown in place of the errors."""
    text, summary = drawn(seed)
    segment, table = folder / f"{seed}.toml", folder / f"{seed}_100.nc"
    segment.write_text(text)
    began = perf_counter()
    try:
        if not table.exists():
            fem.run(str(segment), table, fem.Options(100, (20, 2), 0, 0, quick=False, force=False, quiet=True))
        found = make(prepared(tables.load(table)), seed=0).errors()
    except SceneError as refusal:
        return summary, str(refusal), *[""] * 4
    shares = (found[f"{name}_rms_relative"] for name in ("force", "force_band", "volume"))
    force, band, volume = (f"{100.0 * (share or np.nan):.2f} %" for share in shares)
    radius = f"{1e3 * (found['radius_rms_m'] or np.nan):.3f} mm"
    return summary, force, band, radius, volume, f"{perf_counter() - began:.0f} s"


def main(
    seeds: Annotated[list[int] | None, typer.Argument(help="Seeds of the segments.")] = None,
    folder: Annotated[Path, typer.Option(help="Folder of the tables.")] = Path("runs/drawn_segments"),
) -> None:
    """Print the errors on held-out states of drawn segments."""
    folder.mkdir(parents=True, exist_ok=True)
    for line in markdown_table(TITLES, (row(seed, folder) for seed in seeds or [1, 2, 3, 4])):
        typer.echo(line)


if __name__ == "__main__":
    typer.run(main)
