"""The seed of the random machines stands in the report's head."""

from many import SEED


def pytest_report_header():
    return f"metamorphic: METAMORPHIC_SEED={SEED}"
