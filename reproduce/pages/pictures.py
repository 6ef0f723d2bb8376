"""The glossary's pictures: ``python -m reproduce.pages.pictures docs/media/glossary``; encodings as computed."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from reproduce import style
from reproduce.style import GREY
from reproduce.style import ORACLE as BLUE
from reproduce.style import TACTILE as ORANGE

SEEN = {"elev": 18, "azim": -60}


def encodings(path: Path) -> None:
    """VecBPS, BPS and Pos of one turned L."""
    import matplotlib.pyplot as plt
    import torch
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection
    from scipy.spatial.transform import Rotation

    import object_sets
    from tactile_kit.shape import MeshTable, basis_points, bps_vectors

    (thing,) = object_sets.select("l_shape")
    turn = Rotation.from_euler("xyz", [20, 25, 10], degrees=True).as_matrix()
    meshes = MeshTable.from_meshes([(thing.vertices, thing.faces)])
    rotation = torch.as_tensor(turn[None])
    vectors = bps_vectors(
        meshes, torch.zeros(1, 3, dtype=torch.float64), rotation, torch.zeros(1, dtype=torch.int64)
    )
    points, arrows = basis_points(), vectors[0].numpy().reshape(-1, 3)
    corners = (thing.vertices @ turn.T)[thing.faces]
    figure = plt.figure(figsize=(9.6, 3.4))
    for number, name in enumerate(("VecBPS", "BPS", "Pos"), start=1):
        axes: Any = figure.add_subplot(1, 3, number, projection="3d", **SEEN)
        axes.add_collection3d(
            Poly3DCollection(corners, facecolors=GREY, shade=True, alpha=0.4 if number < 3 else 0.15)
        )
        if number == 1:
            axes.quiver(*points.T, *arrows.T, color=BLUE, linewidth=0.8, arrow_length_ratio=0.12)
            axes.scatter(*points.T, color="black", s=5)
        elif number == 2:
            axes.scatter(*points.T, c=np.linalg.norm(arrows, axis=1), cmap="viridis", s=34)
        else:
            axes.scatter([0], [0], [0], color=ORANGE, s=70)
        axes.set(xlim=(-0.07, 0.07), ylim=(-0.07, 0.07), zlim=(-0.07, 0.07), title=name)
        axes.set_axis_off()
    figure.subplots_adjust(0, 0, 1, 0.92, 0, 0)
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def agents(path: Path) -> None:
    """Who tells the policy of the pose."""
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(9.6, 3.0))
    box = {"boxstyle": "round,pad=0.45", "facecolor": "white", "edgecolor": "black"}
    arrow = {"arrowstyle": "-|>", "color": "black", "shrinkA": 2, "shrinkB": 2}
    for axes, title in zip(panels, ("Oracle", "Tactile agent"), strict=True):
        axes.set(xlim=(0, 10), ylim=(0, 6), title=title)
        axes.set_axis_off()
        axes.text(1.4, 3, "hand and\nobject", ha="center", va="center", bbox=box)
        axes.text(8.3, 3, "policy", ha="center", va="center", bbox=box)
        axes.annotate("", (7.5, 3.2), (2.6, 3.2), arrowprops=arrow)
        axes.text(5, 3.35, "joint angles, control errors", ha="center", fontsize=8)
        axes.annotate("", (2.6, 2.4), (7.5, 2.4), arrowprops=arrow)
        axes.text(5, 1.95, "action", ha="center", fontsize=8)
        axes.text(8.3, 0.7, "mesh, goal", ha="center", fontsize=8)
        axes.annotate("", (8.3, 2.4), (8.3, 1.1), arrowprops=arrow)
    panels[0].annotate(
        "", (8.1, 3.6), (1.6, 3.9), arrowprops=arrow | {"connectionstyle": "arc3,rad=-0.35", "color": ORANGE}
    )
    panels[0].text(5, 5.3, "true pose", ha="center", fontsize=8, color=ORANGE)
    panels[1].text(5, 5.0, "estimator", ha="center", va="center", bbox=box | {"edgecolor": BLUE})
    panels[1].annotate("", (4.1, 5.0), (1.4, 3.8), arrowprops=arrow | {"connectionstyle": "arc3,rad=-0.3"})
    panels[1].annotate(
        "", (8.3, 3.6), (5.9, 5.0), arrowprops=arrow | {"connectionstyle": "arc3,rad=-0.3", "color": BLUE}
    )
    panels[1].text(8.9, 4.9, "estimate, σ", ha="center", fontsize=8, color=BLUE)
    panels[1].text(
        5, 0.3, "ECRL: both learn from the episodes that they make together", ha="center", fontsize=8
    )
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def main(folder: Path) -> None:
    """All pictures into ``folder``."""
    import matplotlib

    style.reset()
    matplotlib.rcParams |= {"svg.hashsalt": "glossary", "font.size": 9}
    folder.mkdir(parents=True, exist_ok=True)
    encodings(folder / "encodings.svg")
    agents(folder / "agents.svg")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
