"""Pictures of benchmarks: one style a code, legends clear of the curves; by matplotlib's own extents."""

import importlib
import itertools

import benchmark_command  # noqa: F401  (whence the modules of benchmarks are found)
import numpy as np
import pytest


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """Draws by a module's function and gives the figure as it was written."""
    from matplotlib import pyplot as plt

    figures = []
    monkeypatch.setattr(plt, "close", figures.append)

    def draw(module, *what):
        function = importlib.import_module(module).draw
        function(*what, tmp_path / "a.png")
        (figure,) = figures
        figure.canvas.draw()
        return figure

    yield draw
    monkeypatch.undo()
    plt.close("all")


def legends_of(figure):
    return [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend() is not None)]


def assert_clear(figure):
    """No legend lies over any panel, none leaves the figure, no two legends meet."""
    boxes = [legend.get_window_extent() for legend in legends_of(figure)]
    assert boxes
    for box in boxes:
        assert not any(box.overlaps(axes.get_window_extent()) for axes in figure.axes if axes.axison)
        assert figure.bbox.x0 - 1 <= box.x0
        assert box.x1 <= figure.bbox.x1 + 1
        assert figure.bbox.y0 - 1 <= box.y0
    words = [one for axes in figure.axes for one in (axes.xaxis.label, axes.title) if one.get_text()]
    assert not any(box.overlaps(word.get_window_extent()) for box in boxes for word in words)
    assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))


def test_work_and_precision(drawn):
    methods = [("flexmbd", f"method {k}") for k in range(5)] + [("exudyn", f"solver {k}") for k in range(7)]
    rows = [
        {"scene": f"scene {s}", "code": code, "method": method, "solve": 10.0**-k, "error": 10.0 ** (k - 6)}
        for s in range(7)
        for code, method in methods
        for k in range(3)
    ]
    figure = drawn("work_precision_picture", rows)
    assert_clear(figure)
    lines = {line.get_label(): line for axes in figure.axes for line in axes.lines if " " in str(line.get_label())}
    assert len({line.get_color() for line in lines.values()}) == 12
    looks = {(label.split()[0], line.get_linestyle(), line.get_marker()) for label, line in lines.items()}
    assert looks == {("flexmbd", "-", "o"), ("exudyn", "--", "s")}
    assert min(text.get_fontsize() for text in figure.legends[0].get_texts()) >= 13


def test_reductions(drawn):
    one = ("flexmbd", "exudyn, scipy", "exudyn, NGSolve", "NGSolve")
    codes = [*((code, 1) for code in one), ("flexmbd", 2), ("flexmbd, iterative", 2)]
    stages = ("assembly", "factor", "static shapes", "responses to loads", "modes", "projection")
    rows = [
        {
            "mesher": mesher, "code": code, "ranks": ranks, "dofs": n,
            "seconds": {"total": n * 1e-4, "geometric": n * 2e-5} | {name: n * 1e-5 for name in stages},
            "memory": {"peak": n * 1e4},
        }
        for mesher in ("gmsh", "netgen") for code, ranks in codes for n in (5e3, 2e4, 1e6)
    ]  # fmt: skip
    figure = drawn("reduction_picture", rows)
    assert_clear(figure)
    assert np.ptp([axes.get_window_extent().width for axes in figure.axes]) < 60.0
