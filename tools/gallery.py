"""The site's gallery: a card and a page for each demo, from its file and from what one run of it printed and drew.

A card has the picture of docs/pictures that has the demo's name, a moving one (.gif) before one that stands. A page has
the demo's text, then what it gives, then the code.

`python tools/gallery.py` runs the demos and keeps their outputs in `out_gallery`, from which any number of builds take
them; `./run docs --outputs FOLDER` takes those of another run, as .ci/run does: a folder a demo, what it printed in
`printed.txt`. Demos that were not run show the picture in docs/pictures of their name.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: Where a run of the demos is kept.
OUTPUTS = ROOT / "out_gallery"
_PICTURES = (".gif", ".png", ".mp4")
_PRINTED = "printed.txt"
#: The examples of the papers that flexmbd's formulations are from, which come first.
_OF_PAPERS = (
    "frontal_impact", "plastic_hinge_pendulum", "spray_boom", "cantilever_tip_mass", "spinning_disc", "spin_up",
    "taylor_bar", "rock_slide",
)  # fmt: skip


def write_pages(folder: Path, *, outputs: Path = OUTPUTS, root: Path = ROOT) -> None:
    """Write the pages of all demos of a checkout, and their index, into a folder of the site's sources."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    demos = sorted((root / "demos").glob("*.py"))
    for demo in demos:
        for card in pictures_of(demo, root)[:1]:
            shutil.copy(card, folder / card.name)
        kept = _outputs(demo, outputs, root)
        for file in kept:
            if file.suffix in _PICTURES:
                shutil.copy(file, folder / f"{demo.stem}-{file.name}")
        (folder / f"{demo.stem}.md").write_text(page_of(demo, kept))
    (folder / "index.md").write_text(_index(demos, root))


def copy_films(folder: Path, built: Path) -> None:
    """Lay the films beside the built pages, which show them by HTML of their own, so that Sphinx does not see them."""
    for film in folder.glob("*.mp4"):
        shutil.copy(film, built)


def pictures_of(demo: Path, root: Path = ROOT) -> list[Path]:
    """The pictures in docs/pictures of a demo's name, a moving one before one that stands."""
    pictures = [root / "docs" / "pictures" / f"{demo.stem}{suffix}" for suffix in (".gif", ".png")]
    return [picture for picture in pictures if picture.exists()]


def page_of(demo: Path, outputs: Sequence[Path]) -> str:
    """The page of a demo: its text, then what it drew and printed, then its code."""
    import jupytext

    cells = [cell for cell in jupytext.read(demo).cells if cell.source.strip()]
    shown = [_shown(f"{demo.stem}-{file.name}", file.suffix) for file in outputs if file.suffix in _PICTURES]
    printed = [file.read_text() for file in outputs if file.name == _PRINTED]
    parts = [cells[0].source.strip(), *shown]
    if printed:
        parts += ["## What it prints", f"```text\n{printed[0].strip()}\n```"]
    parts.append("## The code" if cells[1].cell_type == "code" else "")
    for kind, of_kind in groupby(cells[1:], key=lambda cell: cell.cell_type):
        text = "\n\n".join(cell.source.strip() for cell in of_kind)
        parts.append(text if kind == "markdown" else f"```python\n{text}\n```")
    return "\n\n".join(part for part in parts if part) + "\n"


def run_demos(folder: Path, names: Sequence[str], *, root: Path = ROOT) -> int:
    """Run demos, all unless some are named, one after the other; how many failed."""
    failed = 0
    for demo in sorted((root / "demos").glob("*.py")):
        if names and demo.stem not in names:
            continue
        place = folder / demo.stem
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        print(f"{demo.stem} ...", flush=True)
        with open(place / _PRINTED, "w") as printed:
            environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
            done = subprocess.run([sys.executable, str(demo)], cwd=place, stdout=printed, env=environment)
        if done.returncode:
            failed += 1
            print(f"{demo.stem} ended with {done.returncode}", flush=True)
    return failed


def _outputs(demo: Path, outputs: Path, root: Path) -> list[Path]:
    """What a run of a demo left, or the pictures in the tree of its name."""
    kept = outputs / demo.stem
    if kept.is_dir():
        return sorted(file for file in kept.rglob("*") if file.suffix in _PICTURES or file.name == _PRINTED)
    return pictures_of(demo, root)


def _shown(name: str, suffix: str) -> str:
    if suffix == ".mp4":
        return f'<video controls loop muted playsinline preload="metadata" width="100%" src="{name}"></video>'
    return f"![{name}]({name})"


def _title(demo: Path) -> str:
    return demo.read_text().splitlines()[0].lstrip("# ").strip()


def _index(demos: Sequence[Path], root: Path) -> str:
    of_papers = [demo for name in _OF_PAPERS for demo in demos if demo.stem == name]
    others = [demo for demo in demos if demo.stem not in _OF_PAPERS]
    names = "\n".join(demo.stem for demo in (*of_papers, *others))
    return (
        "# Gallery\n\nEach demo is a file that runs: `./run python demos/slider_crank.py`, most of them also under "
        "`mpirun`.\n\n## The papers' own examples\n\n"
        + _cards(of_papers, root)
        + "\n## Machines, parts and studies\n\n"
        + _cards(others, root)
        + f"\n```{{toctree}}\n:hidden:\n\n{names}\n```\n"
    )


def _cards(demos: Sequence[Path], root: Path) -> str:
    parts = ["::::{grid} 1 2 2 3\n:gutter: 2\n"]
    for demo in demos:
        picture = next((f":img-top: {one.name}\n:img-alt: {_title(demo)}\n" for one in pictures_of(demo, root)), "")
        card = f":::{{grid-item-card}} {_title(demo)}\n:link: {demo.stem}\n:link-type: doc\n"
        parts.append(f"{card}{picture}\n`demos/{demo.name}`\n:::\n")
    return "\n".join([*parts, "::::\n"])


if __name__ == "__main__":
    raise SystemExit(min(1, run_demos(OUTPUTS, sys.argv[1:])))
