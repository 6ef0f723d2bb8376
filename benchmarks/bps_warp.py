"""Basis point sets with NVIDIA Warp's mesh queries on the CPU (no ``annotations`` import: Warp reads them)."""

import torch
import trimesh
import warp as wp

from tactile_kit.shape import basis_points

wp.config.quiet = True
FAR = 10.0  # m


@wp.kernel
def encode_points(
    meshes: wp.array(dtype=wp.uint64),
    points: wp.array(dtype=wp.vec3),
    x: wp.array(dtype=wp.vec3),
    R: wp.array(dtype=wp.mat33),
    which: wp.array(dtype=wp.int64),
    vectors: wp.array2d(dtype=wp.vec3),
):
    row, column = wp.tid()
    turn = R[row]
    place = wp.transpose(turn) * (points[column] - x[row])
    mesh = meshes[int(which[row])]
    found = wp.mesh_query_point_sign_normal(mesh, place, 10.0)
    if found.sign > 0.0:
        closest = wp.mesh_eval_position(mesh, found.face, found.u, found.v)
        vectors[row, column] = turn * (closest - place)


class Warp:
    """Vectors ``(B, 64, 3)`` of ``meshes``, forward and backward."""

    def __init__(self, meshes: list[trimesh.Trimesh]) -> None:
        wp.init()
        self.meshes = [
            wp.Mesh(
                wp.array(mesh.vertices, dtype=wp.vec3, device="cpu"),
                wp.array(mesh.faces.ravel(), dtype=wp.int32, device="cpu"),
            )
            for mesh in meshes
        ]
        self.ids = wp.array([mesh.id for mesh in self.meshes], dtype=wp.uint64, device="cpu")
        self.points = wp.array(basis_points(), dtype=wp.vec3, device="cpu")

    def _launch(self, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor, grad: bool) -> tuple:
        inputs = [
            wp.from_torch(x, dtype=wp.vec3, requires_grad=grad),
            wp.from_torch(R, dtype=wp.mat33, requires_grad=grad),
            wp.from_torch(mesh, dtype=wp.int64),
        ]
        shape = (len(x), len(self.points))
        vectors = wp.zeros(shape, dtype=wp.vec3, device="cpu", requires_grad=grad)
        wp.launch(
            encode_points, shape, inputs=[self.ids, self.points, *inputs], outputs=[vectors], device="cpu"
        )
        return inputs, vectors

    def __call__(self, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
        return wp.to_torch(self._launch(x, R, mesh, grad=False)[1])

    def recorded(self, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor, gradient: torch.Tensor):
        """A call that fills the gradients in x and R, and those two tensors."""
        tape = wp.Tape()
        with tape:
            (x_array, R_array, _), vectors = self._launch(x, R, mesh, grad=True)
        given = {vectors: wp.from_torch(gradient.contiguous(), dtype=wp.vec3)}
        return lambda: tape.backward(grads=given), wp.to_torch(x_array.grad), wp.to_torch(R_array.grad)
