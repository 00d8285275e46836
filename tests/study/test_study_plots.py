"""Plots of a study: names with units, and nothing cut off, however long a study's cases are called."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from sim_bridge.lab.study.results import plots
from sim_bridge.lab.study.results.figures import BY_NAME, ESTIMATOR, FLIGHT
from sim_bridge.lab.study.results.summary import summarise

LONG = "the whole stack on the quadrotors of the simulator, with recorded estimates and the radio of an old forest"


def rows(backend: str) -> list[dict[str, Any]]:
    figures = {figure.name: 0.5 for figure in (*FLIGHT, *ESTIMATOR) if figure.of_case is None}
    return [
        {"run": f"{LONG} {run}", "law": "ours", "backend": backend, "n": n, "status": "flown", "arrived": True}
        | {"settings": {"swarm.size": n, "radio.transit_range_m": reach}, "seed": 1}
        | figures
        for run in (1, 2)
        for n in (4, 8)
        for reach in (30.0, 40.0)
    ]


def test_no_label_of_a_plot_is_cut_and_each_is_a_name_with_its_unit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: dict[str, Figure] = {}
    monkeypatch.setattr(Figure, "savefig", lambda self, file, **_: drawn.update({file.stem: self}))
    plots.draw(summarise(rows("agents")), tmp_path)

    assert len(drawn) > 20
    for name, figure in drawn.items():
        figure.draw_without_rendering()
        whole = figure.bbox.padded(1.0)
        axis = figure.axes[0]
        texts = [axis.xaxis.label, axis.yaxis.label, *figure.legends[0].get_texts()]
        assert any(LONG[:40] in text.get_text() for text in texts)
        for text in texts:
            box = text.get_window_extent()
            assert whole.contains(box.x0, box.y0), (name, text.get_text())
            assert whole.contains(box.x1, box.y1), (name, text.get_text())
        label = figure.axes[0].get_ylabel().replace("\n", " ")
        assert label == BY_NAME[name].heading
        assert "_" not in label
        assert figure.axes[0].bbox.height > 200, "room for the plot itself"


def test_every_figure_of_studies_has_a_name_of_its_own() -> None:
    for backend in (FLIGHT, ESTIMATOR):
        names = [figure.heading for figure in backend]
        assert all(names)
        assert len(set(names)) == len(names)
        assert not [name for name in names if "_" in name]
