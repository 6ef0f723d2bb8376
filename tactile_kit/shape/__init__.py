"""Shape encodings: what the policy and the estimator are told about the object's shape (paper section III-A)."""

from object_sets.errors import MeshError
from tactile_kit.shape.base import Encoding
from tactile_kit.shape.bps import BPS
from tactile_kit.shape.function import PoseError, basis_points, bps_vectors
from tactile_kit.shape.registry import ENCODINGS, encoding, kind_of, names
from tactile_kit.shape.tables import MeshTable
from tactile_kit.shape.vec_bps import VecBPS

__all__ = [
    "BPS",
    "ENCODINGS",
    "Encoding",
    "MeshError",
    "MeshTable",
    "PoseError",
    "VecBPS",
    "basis_points",
    "bps_vectors",
    "encoding",
    "kind_of",
    "names",
]
