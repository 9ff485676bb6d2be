"""The modules of `python -m benchmarks`, which lie in a folder that python does not look into."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks"))

import page as page  # noqa: E402
import results as results  # noqa: E402
from benchmark import Report as Report  # noqa: E402
from discovery import benchmarks as benchmarks  # noqa: E402
from discovery import minutes_of as minutes_of  # noqa: E402
from discovery import text_of as text_of  # noqa: E402
