"""Similarities, y = scale R x + t, and how far one is from another."""

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True)
class Similarity:
    """y = scale R x + t."""

    scale: float
    rotation: np.ndarray  # (3, 3), proper
    translation: np.ndarray  # (3,)

    @classmethod
    def from_matrix(cls, matrix):
        """Of a homogeneous matrix whose upper left block is a rotation times a positive scale."""
        block = np.asarray(matrix, float)[:3, :3]
        scale = float(np.cbrt(np.linalg.det(block)))
        return cls(scale, block / scale, np.asarray(matrix, float)[:3, 3].copy())

    def matrix(self):
        """Homogeneous (4, 4)."""
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = self.scale * self.rotation, self.translation
        return out

    def apply(self, points):
        """Points (n, 3) or one point (3,)."""
        return self.scale * points @ self.rotation.T + self.translation

    def enlarged(self, factor):
        """The same map into a target whose unit is 1 / factor of the old one."""
        return Similarity(self.scale * factor, self.rotation, self.translation * factor)

    def is_finite(self):
        """Neither degenerate nor overflown."""
        return bool(np.isfinite(self.matrix()).all() and self.scale > 0)


def rotation_about(axis, angle_rad):
    """Rodrigues' formula; the axis is of unit length."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle_rad) * cross + (1 - np.cos(angle_rad)) * cross @ cross


def angle_between_deg(first, second):
    """The angle of the rotation that takes one into the other."""
    # The chord keeps its precision at small angles, where the trace loses it.
    chord = np.linalg.norm(first - second) / np.sqrt(8)
    return float(np.degrees(2 * np.arcsin(np.clip(chord, 0, 1))))
