"""The site's pages of all numbers: what was verified, and what was measured, from the results that are kept."""

from __future__ import annotations

import shutil
from pathlib import Path


def write_pages(folder: Path) -> None:
    """Write the pages and their index into a folder of the site's sources; benchmarks/ is on the search path."""
    import page as benchmark_page

    from verification import page as verification_page
    from verification import results

    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    names = [*verification_page.write_numbers(folder, results.load()), *benchmark_page.write_numbers(folder)]
    listed = "\n".join(names)
    (folder / "index.md").write_text(
        "# All numbers\n\nOf [verification](../verification.md), published and ours, and of "
        "[benchmarks](../benchmarks.md), as they were kept when each last ran.\n\n"
        f"```{{toctree}}\n:maxdepth: 1\n\n{listed}\n```\n"
    )
