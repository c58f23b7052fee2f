"""Surfaces of all components of a machine, and their nearest places to many points at once."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.spatial

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.parts.nearest_places import find_nearest_in_triangles
from headstock.geometry.parts.skins import IntArray, Skin


@dataclass(frozen=True, eq=False)
class _Class:
    """Triangles of about one size, by their middles."""

    tree: scipy.spatial.cKDTree
    triangles: IntArray
    radius: float


class MachineSurface:
    """Triangles of components where they stand in a machine.

    Attributes:
        names: Components.
        owners: ``(t,)`` index of the component of each triangle.
        normals: ``(t, 3)`` of each triangle; zero of one without area.
        size: Diagonal of the box around all of them [m].
        middle: ``(3,)`` of that box [m].
    """

    def __init__(self, skins: Mapping[str, Skin], frames: Mapping[str, Frame]) -> None:
        self.names = tuple(skins)
        corners = [
            frames[name].origin + (skin.points[skin.triangles] @ frames[name].rotation.T)
            for name, skin in skins.items()
        ]
        self.owners = np.repeat(np.arange(len(corners)), [len(each) for each in corners])
        self._corners = np.concatenate(corners)
        across = np.cross(*np.moveaxis(np.diff(self._corners, axis=1), 1, 0))
        areas = np.linalg.norm(across, axis=1, keepdims=True)
        self.normals = across / np.where(areas > 0.0, areas, 1.0)
        low, high = self._corners.min(axis=(0, 1)), self._corners.max(axis=(0, 1))
        self.size = float(np.linalg.norm(high - low))
        self.middle = 0.5 * (low + high)
        middles = self._corners.mean(axis=1)
        radii = np.linalg.norm(self._corners - middles[:, None], axis=2).max(axis=1)
        # one tree per octave: a few large triangles must not widen the search among small ones
        octaves = np.floor(np.log2(np.maximum(radii, 1e-9 * self.size))).astype(int)
        self._classes = [
            _Class(scipy.spatial.cKDTree(middles[which]), which, float(radii[which].max()))
            for which in (np.flatnonzero(octaves == octave) for octave in np.unique(octaves))
        ]

    def nearest(self, places: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Find the nearest place ``(n, 3)``, its distance ``(n,)`` [m] and its triangle ``(n,)``.

        Args:
            places: ``(n, 3)`` [m].
        """
        first = [each.triangles[each.tree.query(places)[1]] for each in self._classes]
        bounds = np.min(
            [
                np.linalg.norm(
                    find_nearest_in_triangles(self._corners[which], places) - places, axis=1
                )
                for which in first
            ],
            axis=0,
        )
        # no triangle with its middle further away than this can be nearer
        points, triangles = [], []
        for each in self._classes:
            near = each.tree.query_ball_point(places, (bounds + each.radius) * (1 + 1e-9))
            counts = list(map(len, near))
            points.append(np.repeat(np.arange(len(places)), counts))
            triangles.append(each.triangles[np.concatenate(near).astype(int)])
        point, triangle = np.concatenate(points), np.concatenate(triangles)
        found = find_nearest_in_triangles(self._corners[triangle], places[point])
        distances = np.linalg.norm(found - places[point], axis=1)
        order = np.lexsort((distances, point))
        best = order[np.unique(point[order], return_index=True)[1]]
        return found[best], distances[best], triangle[best]
