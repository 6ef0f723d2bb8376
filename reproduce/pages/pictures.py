"""The glossary's pictures: ``python -m reproduce.pages.pictures docs/media/glossary``; encodings as computed."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from reproduce import style
from reproduce.style import GREY
from reproduce.style import ORACLE as BLUE
from reproduce.style import TACTILE as ORANGE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEEN = {"elev": 18, "azim": -60}


def encodings(folder: Path) -> None:
    """VecBPS, BPS and Pos of one turned L, a picture each: beside each other where there is room."""
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
    for name in ("VecBPS", "BPS", "Pos"):
        figure = plt.figure(figsize=(2.45, 2.6))
        axes: Any = figure.add_subplot(projection="3d", **SEEN)
        axes.add_collection3d(
            Poly3DCollection(corners, facecolors=GREY, shade=True, alpha=0.15 if name == "Pos" else 0.4)
        )
        if name == "VecBPS":
            axes.quiver(*points.T, *arrows.T, color=BLUE, linewidth=0.6, arrow_length_ratio=0.12)
            axes.scatter(*points.T, color="black", s=3)
        elif name == "BPS":
            axes.scatter(*points.T, c=np.linalg.norm(arrows, axis=1), cmap="viridis", s=20)
        else:
            axes.scatter([0], [0], [0], color=ORANGE, s=50)
        axes.set(xlim=(-0.07, 0.07), ylim=(-0.07, 0.07), zlim=(-0.07, 0.07), title=name)
        axes.set_axis_off()
        figure.subplots_adjust(0, 0, 1, 0.92)
        _save(figure, folder / f"{name.lower()}.svg")


def agents(folder: Path) -> None:
    """Who tells the policy of the pose: an oracle's picture and a tactile agent's."""
    import matplotlib.pyplot as plt

    box = {"boxstyle": "round,pad=0.45", "facecolor": "white", "edgecolor": "black"}
    arrow = {"arrowstyle": "-|>", "color": "black", "shrinkA": 2, "shrinkB": 2}
    for name, title in (("oracle", "Oracle"), ("tactile", "Tactile agent")):
        figure, axes = plt.subplots(figsize=(3.7, 2.6))
        axes.set(xlim=(0, 10), ylim=(0, 6), title=title)
        axes.set_axis_off()
        axes.text(1.4, 3, "hand and\nobject", ha="center", va="center", bbox=box)
        axes.text(8.3, 3, "policy", ha="center", va="center", bbox=box)
        axes.annotate("", (7.5, 3.2), (2.6, 3.2), arrowprops=arrow)
        axes.text(5, 3.35, "joint angles, control errors", ha="center")
        axes.annotate("", (2.6, 2.4), (7.5, 2.4), arrowprops=arrow)
        axes.text(5, 1.9, "action", ha="center")
        axes.text(8.3, 0.9, "mesh, goal", ha="center")
        axes.annotate("", (8.3, 2.5), (8.3, 1.3), arrowprops=arrow)
        if name == "oracle":
            over = arrow | {"connectionstyle": "arc3,rad=-0.35", "color": ORANGE}
            axes.annotate("", (8.1, 3.6), (1.6, 3.9), arrowprops=over)
            axes.text(5, 5.3, "true pose", ha="center", color=ORANGE)
        else:
            axes.text(5, 5.0, "estimator", ha="center", va="center", bbox=box | {"edgecolor": BLUE})
            bent = arrow | {"connectionstyle": "arc3,rad=-0.3"}
            axes.annotate("", (3.9, 5.0), (1.4, 3.8), arrowprops=bent)
            axes.annotate("", (8.3, 3.6), (6.1, 5.0), arrowprops=bent | {"color": BLUE})
            axes.text(8.6, 5.0, "estimate, σ", ha="center", color=BLUE)
            axes.text(5, 0.05, "ECRL: both learn from the episodes they make", ha="center")
        figure.subplots_adjust(0.01, 0.02, 0.99, 0.9)
        _save(figure, folder / f"{name}.svg")


def _save(figure: Figure, path: Path) -> None:
    import matplotlib.pyplot as plt

    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def main(folder: Path) -> None:
    """All pictures into ``folder``."""
    import matplotlib

    style.reset()
    matplotlib.rcParams |= {"svg.hashsalt": "glossary", "font.size": 9}
    folder.mkdir(parents=True, exist_ok=True)
    encodings(folder)
    agents(folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
