"""The site's gallery: a page for each demo, from its file and from what one run of it printed and drew.

`python tools/gallery.py` runs the demos and keeps their outputs in `out_gallery`, from which any number of builds take
them; `./run docs --outputs FOLDER` takes those of another run, as .ci/run does: a folder a demo, what it printed in
`printed.txt`. Demos that were not run show their text, their code and the picture in docs/pictures of their name.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: Where a run of the demos is kept.
OUTPUTS = ROOT / "out_gallery"
_PICTURES = (".png", ".gif", ".mp4")
_PRINTED = "printed.txt"


def write_pages(folder: Path, *, outputs: Path = OUTPUTS, root: Path = ROOT) -> None:
    """Write the pages of all demos of a checkout, and their index, into a folder of the site's sources."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    demos = sorted((root / "demos").glob("*.py"))
    for demo in demos:
        kept = _outputs(demo, outputs, root)
        for file in kept:
            if file.suffix in _PICTURES:
                shutil.copy(file, folder / f"{demo.stem}-{file.name}")
        (folder / f"{demo.stem}.md").write_text(page_of(demo, kept))
    (folder / "index.md").write_text(_index(demos, folder))


def copy_films(folder: Path, built: Path) -> None:
    """Lay the films beside the built pages, which show them by HTML of their own, so that Sphinx does not see them."""
    for film in folder.glob("*.mp4"):
        shutil.copy(film, built)


def page_of(demo: Path, outputs: Sequence[Path]) -> str:
    """The page of a demo: its text and code, then what it drew and printed."""
    import jupytext

    parts = []
    for cell in jupytext.read(demo).cells:
        text = cell.source.strip()
        if text:
            parts.append(text if cell.cell_type == "markdown" else f"```python\n{text}\n```")
    shown = [_shown(f"{demo.stem}-{file.name}", file.suffix) for file in outputs if file.suffix in _PICTURES]
    printed = [file.read_text() for file in outputs if file.name == _PRINTED]
    if shown:
        parts += ["## What it draws", *shown]
    if printed:
        parts += ["## What it prints", f"```text\n{printed[0].strip()}\n```"]
    return "\n\n".join(parts) + "\n"


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
    """What a run of a demo left, or the picture in the tree of its name."""
    kept = outputs / demo.stem
    if kept.is_dir():
        return sorted(file for file in kept.rglob("*") if file.suffix in _PICTURES or file.name == _PRINTED)
    picture = root / "docs" / "pictures" / f"{demo.stem}.png"
    return [picture] if picture.exists() else []


def _shown(name: str, suffix: str) -> str:
    if suffix == ".mp4":
        return f'<video controls loop muted playsinline preload="metadata" width="100%" src="{name}"></video>'
    return f"![{name}]({name})"


def _title(demo: Path) -> str:
    return demo.read_text().splitlines()[0].lstrip("# ").strip()


def _index(demos: Sequence[Path], folder: Path) -> str:
    def cards() -> Iterator[str]:
        for demo in demos:
            yield f":::{{grid-item-card}} {_title(demo)}\n:link: {demo.stem}\n:link-type: doc"
            pictures = sorted(folder.glob(f"{demo.stem}-*.png"))
            if pictures:
                yield f":img-bottom: {pictures[0].name}"
            yield f"`demos/{demo.name}`\n:::\n"

    names = "\n".join(demo.stem for demo in demos)
    return (
        "# Gallery\n\nEach demo is a file that runs: `./run python demos/slider_crank.py`, most of them also under "
        "`mpirun`.\n\n::::{grid} 1 2 2 3\n:gutter: 2\n\n"
        + "\n".join(cards())
        + f"\n::::\n\n```{{toctree}}\n:hidden:\n\n{names}\n```\n"
    )


if __name__ == "__main__":
    raise SystemExit(min(1, run_demos(OUTPUTS, sys.argv[1:])))
