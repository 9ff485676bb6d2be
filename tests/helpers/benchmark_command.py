"""The modules of `python -m benchmarks`, which lie in a folder that python does not look into."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks"))

import page as page
import results as results
from benchmark import Comparison as Comparison
from benchmark import Report as Report
from discovery import benchmarks as benchmarks
from discovery import is_timed as is_timed
from discovery import minutes_of as minutes_of
from discovery import text_of as text_of
