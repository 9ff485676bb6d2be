"""The thousand machines run where they are asked for by their marker; the seed stands in the report's head."""

from many import SEED


def pytest_report_header():
    return f"metamorphic: METAMORPHIC_SEED={SEED}"


def pytest_collection_modifyitems(config, items):
    if "thousand" in config.option.markexpr:
        return
    left = [item for item in items if item.get_closest_marker("thousand")]
    if left:
        config.hook.pytest_deselected(items=left)
        items[:] = [item for item in items if not item.get_closest_marker("thousand")]
