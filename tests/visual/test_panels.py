"""Curves over time: one panel a unit, legends that cover nothing, one function for the library and the shell."""

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import ExportError, PictureError
from flexmbd.files.result_table import ResultTable
from flexmbd.visual import plot_table

T = np.linspace(0.0, 1.0, 5)


@pytest.fixture(scope="module")
def swing():
    """A block on a hinge on a slide: one coordinate in m, one in rad."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    cart = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="cart")
    bob = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (0.0, 0.0, -0.5)), name="bob")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), cart.frame(), name="slide")
    hinge = scene.connect(fm.joint.Revolute("y"), cart.frame(), bob.frame(), name="hinge")
    both = scene.connect(fm.joint.Cylindrical("z"), bob.frame(), scene.add(fm.RigidBody(0.1, (1.0,) * 3)).frame())
    hinge.position = 0.5
    return scene.simulate(0.3, rtol=1e-5), slide, hinge, both


def test_each_unit_has_a_panel(swing, tmp_path):
    run, slide, hinge, both = swing
    bob = run.bodies["bob"]
    figure = run.plot(
        slide, hinge, ("bob", bob.frame()), both,
        ("speed [m/s]", lambda t: run.beta_rate(slide, t=t)), ("a number", run.t), path=tmp_path / "a.png",
        title="swing",
    )  # fmt: skip
    found = {axes.get_ylabel(): [line.get_label() for line in axes.lines] for axes in figure.axes}
    along, turn = (f"{both.name} {name}" for name in both.joint.velocity_names)
    assert both.joint.angular == (False, True)
    assert found == {
        "in m": ["slide", "bob x", "bob y", "bob z", along],
        "in rad": ["hinge", turn],
        "in m/s": ["speed"],
        "": ["a number"],
    }
    assert [axes.get_xlabel() for axes in figure.axes][-1] == "time in s"
    assert figure.axes[0].get_title() == "swing"


@pytest.mark.parametrize("count", [1, 2, 5, 14, 15, 40])
def test_the_legend_covers_no_curve(count):
    """By matplotlib's own extents: the legend's box lies right of the axes and within the figure."""
    figure = plot_table(table_of(count), path=None)
    figure.canvas.draw()
    for axes in figure.axes:
        legend = axes.get_legend()
        if count == 1 and len(figure.axes) == 1:
            assert legend is None
            continue
        box, data = legend.get_window_extent(), axes.get_window_extent()
        assert box.x0 >= data.x1
        assert box.x1 <= figure.bbox.x1 + 1.0
        assert box.y0 >= figure.bbox.y0 - 1.0
        assert data.width > 0.4 * figure.bbox.width
    close(figure)


def close(figure):
    from matplotlib import pyplot as plt

    plt.close(figure)


def table_of(count):
    names = ("t", *(f"body {k}.x" for k in range(count)))
    return ResultTable(names, ("s", *["m"] * count), np.column_stack([T, *(k + T for k in range(count))]))


def test_curves_of_one_panel_differ_in_colour():
    figure = plot_table(table_of(40))
    assert len({line.get_color() for line in figure.axes[0].lines}) == 40
    close(figure)


def test_columns_of_a_table(tmp_path):
    table = ResultTable(("t", "a.x", "a.y", "b.q0"), ("s", "m", "m", "1"), np.column_stack([T, T**2, -T, 0 * T]))
    figure = plot_table(table, ["a.x", "b.q0"], path=tmp_path / "a.svg", title="title")
    above, below = figure.axes
    assert (above.get_ylabel(), below.get_ylabel(), below.get_xlabel()) == ("in m", "", "t in s")
    for line, name in zip([*above.lines, *below.lines], ("a.x", "b.q0"), strict=True):
        assert line.get_label() == name
        np.testing.assert_array_equal(line.get_ydata(), table.column(name))
        np.testing.assert_array_equal(line.get_xdata(), T)
    assert (tmp_path / "a.svg").exists()
    with pytest.raises(ExportError, match="no column 'c'"):
        plot_table(table, ["c"])
    with pytest.raises(PictureError, match="nothing to draw"):
        plot_table(ResultTable(("t",), ("s",), T[:, None]))


def test_one_curve_names_its_panel(swing, tmp_path):
    run, slide, hinge, _ = swing
    assert run.plot(hinge, path=tmp_path / "a.png").axes[0].get_ylabel() == "hinge in rad"
    assert run.plot(("way", slide), path=tmp_path / "a.png", ylabel="way in m").axes[0].get_ylabel() == "way in m"
    assert run.plot(path=tmp_path / "a.png").axes[0].get_ylabel() == "energy in J"
    with pytest.raises(PictureError, match="a series is a joint"):
        run.plot(3.0)


def test_a_notebook_shows_a_figure_once(swing):
    """IPython asks a cell's value to display itself: nothing while pyplot, which shows it at the end, holds it."""
    import matplotlib.pyplot as plt

    run, slide, *_ = swing
    figure = run.plot(slide)
    assert figure._ipython_display_() is None
    plt.close(figure)
    with pytest.raises(NotImplementedError):  # which IPython takes for: show the picture
        figure._ipython_display_()
