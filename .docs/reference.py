"""Write the pages of the reference from the program's own declarations: `python .docs/reference.py OUT`."""

from __future__ import annotations

import argparse
from pathlib import Path

from pages.api import api
from pages.commands import commands
from pages.exit_codes import exit_codes
from pages.file_format import file_format
from pages.scene_keys import scene_keys
from pages.series import series
from pages.summary import summary
from scenes.models.loading import load_scene
from scenes.records.record import Record
from scenes.running.runner import simulate

GLOSSARY = Path(__file__).resolve().with_name("glossary.md")
EXAMPLES = {
    "worm": "flat",
    "worm_control": "path_circle",
    "load_frame": "load_frame",
    "worm_planar": "planar_case",
    "planar_published": "planar_published",
    "planar_linkage": "planar_wave",
}
"""A scene of each model."""

REFERENCE_INDEX = """# Reference

Most pages of the reference are made from the declarations of the program. Each page lists all items of a kind.

* [Keys of scenes](scene_keys.md): unit, range, default and meaning of each key.
* [Figures of a summary](summary.md): meaning, definition, and reasons for missing values.
* [Recorded series](series.md): unit, shape and meaning.
* [Commands](commands.md): all options of `worm3d`.
* [Exit codes](exit_codes.md).
* [File format of results](file_format.md): groups, variables and attributes of `result.nc`.
* [Python names](api.md): signatures and docstrings.
* [Glossary](glossary.md): the terms of this book, with a sentence each.

```{toctree}
:hidden:

scene_keys
summary
series
commands
exit_codes
file_format
api
glossary
```
"""


def short_runs() -> dict[str, Record]:
    """Return a run of 0.4 s for each model, by the name of the model."""
    return {model: simulate(load_scene(name, ["run.duration_s=0.4"])) for model, name in EXAMPLES.items()}


def main(folder: Path) -> None:
    """Write the pages into the folder `reference` of `folder`."""
    runs = short_runs()
    written = {
        "index": REFERENCE_INDEX,
        "scene_keys": scene_keys(),
        "summary": summary(runs),
        "series": series(runs),
        "commands": commands(),
        "exit_codes": exit_codes(),
        "file_format": file_format(runs),
        "api": api(),
        "glossary": GLOSSARY.read_text(encoding="utf-8"),
    }
    (folder / "reference").mkdir(parents=True, exist_ok=True)
    for name, text in written.items():
        (folder / "reference" / f"{name}.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("folder", type=Path, help="folder for the folder 'reference'")
    main(options.parse_args().folder)
