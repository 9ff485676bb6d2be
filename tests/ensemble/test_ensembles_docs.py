"""The examples of docs/ensembles.md run."""

from __future__ import annotations

import re
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "ensembles.md"


def test_the_page_s_examples_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    first, second, quick, mpi, dask = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    for block in (first, second, quick):
        exec(compile(block, str(PAGE), "exec"), names)
    told = capsys.readouterr().out
    assert "(200, 11, 3)" in told
    assert "(200, 11, 3) (200,)" in told
    assert (tmp_path / "study.h5").exists()
    assert "MPIPoolExecutor(main=False)" in mpi  # which test_ensemble.py runs
    assert "client.get_executor()" in dask  # which test_executors.py runs
