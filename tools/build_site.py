"""Builds the documentation's site into the folder `site`: `./run docs`; with `--demos` after a run of all demos."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import gallery

ROOT = Path(__file__).resolve().parents[1]


def main() -> int:
    """Build; 0 where there was nothing to warn of."""
    parser = argparse.ArgumentParser(prog="./run docs", description=__doc__)
    parser.add_argument("--demos", action="store_true", help="run all demos first, for the gallery (ten minutes)")
    kept = "what an earlier run of the demos left, a folder each"
    parser.add_argument("--outputs", type=Path, default=gallery.OUTPUTS, metavar="FOLDER", help=kept)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "site", help="folder of the site (default: site)")
    arguments = parser.parse_args()
    if arguments.demos and gallery.run_demos(arguments.outputs, ()):
        return 1
    sphinx = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    # for the next build, and no part of the site
    trees = arguments.output.with_name(f".{arguments.output.name}_doctrees")
    outputs = f"gallery_outputs={arguments.outputs.resolve()}"
    folders = ["-d", str(trees), str(ROOT / "docs"), str(arguments.output)]
    status = subprocess.run([*sphinx, "-D", outputs, *folders], check=False).returncode
    if status == 0:
        print(f"the site is in {arguments.output}: open {arguments.output / 'index.html'}")
    return status


if __name__ == "__main__":
    raise SystemExit(main())
