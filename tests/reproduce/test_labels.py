"""Labels of figures touch nothing: neither each other, nor the edge, nor the intervals of bars."""

from __future__ import annotations

import importlib
import itertools

import pytest

from reproduce.plan import FIGURES

DRAWN = [name for name in FIGURES if name != "object_sets"]  # that one is object_sets' own sheet


def labels(made):
    """(words, box in pixels) of every text that is seen."""
    from matplotlib.text import Text

    made.canvas.draw()
    unseen = set()
    for axes in made.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            for tick, place in zip(axis.get_major_ticks(), axis.get_majorticklocs(), strict=True):
                if not axes.axison or not low - 1e-9 <= place <= high + 1e-9:
                    unseen |= {tick.label1, tick.label2}
        if not axes.axison:
            unseen |= {axes.xaxis.label, axes.yaxis.label}
    texts = [text for text in made.findobj(Text) if text.get_visible() and text.get_text().strip()]
    return [(text.get_text(), text.get_window_extent()) for text in texts if text not in unseen]


def whiskers(made):
    """Boxes of the intervals' lines."""
    from matplotlib.collections import LineCollection
    from matplotlib.transforms import Bbox

    lines = [lines for axes in made.axes for lines in axes.findobj(LineCollection)]
    ends = [one.get_transform().transform(segment) for one in lines for segment in one.get_segments()]
    return [Bbox([both.min(0), both.max(0)]).padded(0.5) for both in ends]  # a line has no width


def touch(one, other) -> bool:
    return (
        min(one.x1, other.x1) - max(one.x0, other.x0) > 0.5
        and min(one.y1, other.y1) - max(one.y0, other.y0) > 0.5
    )


def faults(made):
    seen, size = labels(made), made.bbox
    found = [
        f"{a!r} and {b!r}" for (a, one), (b, other) in itertools.combinations(seen, 2) if touch(one, other)
    ]
    found += [f"{a!r} and an interval" for a, one in seen for other in whiskers(made) if touch(one, other)]
    return found + [
        f"{a!r} leaves the figure"
        for a, one in seen
        if one.x0 < -1 or one.y0 < -1 or one.x1 > size.x1 + 1 or one.y1 > size.y1 + 1
    ]


def drawn(name, world, tmp_path, monkeypatch):
    module = importlib.import_module(f"reproduce.artefacts.{name}")
    kept = []
    monkeypatch.setattr(module, "save", lambda made, _: kept.append(made))
    module.make(world.results, [tmp_path / f"{name}.{suffix}" for suffix in ("png", "svg", "csv")])
    return kept[0]


@pytest.fixture(autouse=True)
def closed():
    import matplotlib.pyplot as plt

    yield
    plt.close("all")


@pytest.mark.parametrize("name", DRAWN)
def test_labels_touch_nothing(name, full_world, tmp_path, monkeypatch):
    assert faults(drawn(name, full_world, tmp_path, monkeypatch)) == []


@pytest.mark.parametrize("name", DRAWN)
def test_words_for_what_is_missing_touch_nothing(name, world, tmp_path, monkeypatch):
    assert faults(drawn(name, world, tmp_path, monkeypatch)) == []


@pytest.mark.parametrize("name", DRAWN)
def test_figures_are_a_column_or_a_page_wide(name, world, tmp_path, monkeypatch):
    from reproduce.style import COLUMN, PAGE

    assert drawn(name, world, tmp_path, monkeypatch).get_figwidth() in (COLUMN, PAGE)


def test_faults_are_seen():
    from reproduce.style import COLUMN, figure

    made, (axes,) = figure(COLUMN, 2)
    axes.set(xlim=(0, 1), ylim=(0, 1))
    axes.errorbar([0.5], [0.5], yerr=[[0.2], [0.2]])
    axes.text(0.5, 0.5, "on it", ha="center")
    axes.text(0.52, 0.5, "on both")
    axes.text(3, 0.5, "outside").set_in_layout(False)
    said = " ".join(faults(made))
    assert (
        "'on it' and 'on both'" in said and "'on it' and an interval" in said and "'outside' leaves" in said
    )
