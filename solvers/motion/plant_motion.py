"""A machine along its trajectory as a linear system in time, and its outputs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.motion.alpha import (
    CompliantHistory,
    LinearMotion,
    apply_matrices,
    chunk_slices,
    even_nodes,
    interpolate_nodes,
)
from headstock.solvers.motion.plant import SampledMotion, SampledPlant
from headstock.solvers.second_order import Channel
from headstock.solvers.watched_outputs import Watch

NODE_SPACING = 0.02
LOAD_SPACING = 1e-3


@dataclass(frozen=True, eq=False)
class TrajectoryLoads:
    """Describe the loads on a machine along its trajectory.

    Attributes:
        at: Returns their values ``(n, r)`` at times ``(n,)``.
        weight: Channel of gravity: the deflection under gravity alone is no deviation.
    """

    channels: tuple[Channel, ...]
    at: Callable[[FloatArray], FloatArray]
    weight: Channel

    def deviating(self, times: FloatArray) -> FloatArray:
        """Return the values ``(n, r)`` at times ``(n,)``, with zero gravity."""
        values = np.array(self.at(times))
        values[:, self.channels.index(self.weight)] = 0.0
        return values


def follow_motion(
    sampled: SampledMotion,
    times: FloatArray,
    loads: TrajectoryLoads,
    tool: Sequence[Channel],
    *,
    node_spacing: float = NODE_SPACING,
    load_spacing: float = LOAD_SPACING,
) -> LinearMotion:
    """Return the linear system along a trajectory: matrices at nodes, loads of the rigid motion at
    finer ones.

    Args:
        times: ``(n,)`` even steps [s].
        loads: Loads except those on the tool.
        tool: Three inputs of force and three outputs of motion of the tool.
        node_spacing: Time between which matrices are linear [s].
        load_spacing: Time between which loads are linear [s].
    """
    nodes, load_nodes = even_nodes(times, node_spacing), even_nodes(times, load_spacing)
    plant, moved = sampled.at(nodes), sampled.channels.rows.of(tool)
    given = sampled.channels.columns.of(loads.channels)
    acting, rests = [], []
    for part in chunk_slices(len(load_nodes)):
        now = load_nodes[part]
        finer = sampled.at(now, "loads", "direct")
        acting.append(apply_matrices(finer.loads[:, :, given], loads.at(now)))
        # deflection under gravity is no deviation, for the modes left out as well
        beyond = finer.direct[:, moved][:, :, given]
        rests.append(apply_matrices(beyond, loads.deviating(now)))
    weight = loads.at(nodes)[:, loads.channels.index(loads.weight)]
    return LinearMotion(
        times=times,
        nodes=nodes,
        mass=np.broadcast_to(np.eye(sampled.modes), plant.stiffness.shape),
        damping=plant.damping,
        stiffness=plant.stiffness,
        tool=plant.rows_of(tool),
        gravity_deflection=np.asarray(
            np.linalg.solve(
                plant.stiffness, plant.loads_of([loads.weight]) * weight[:, None, None]
            )[..., 0]
        ),
        load=interpolate_nodes(times, load_nodes, np.concatenate(acting)),
        flexibility=plant.direct_of(tool, tool),
        rest=interpolate_nodes(times, load_nodes, np.concatenate(rests)),
    )


def interpolate_smooth(
    given: Callable[[FloatArray], FloatArray], times: FloatArray, spacing: float = LOAD_SPACING
) -> FloatArray:
    """Return values ``(n, r)`` at times ``(n,)`` of a function as smooth as the rigid motion:
    linear between nodes at a given spacing, where these are fewer [s].
    """
    nodes = even_nodes(times, spacing)
    return (
        given(times) if len(nodes) >= len(times) else interpolate_nodes(times, nodes, given(nodes))
    )


@dataclass(frozen=True, eq=False)
class SampledHistory:
    """Store the motion of a machine along its trajectory, and its inputs other than gravity.

    Attributes:
        motion: The machine; its first coordinates are its modes.
        plant: Its matrices at the nodes of the motion.
        acting: Returns values ``(m, k)`` of these in a slice of the steps.
    """

    motion: LinearMotion
    history: CompliantHistory
    plant: SampledPlant
    inputs: tuple[Channel, ...]
    acting: Callable[[slice], FloatArray]

    def observe(self, watch: Watch) -> FloatArray:
        """Return watched outputs ``(n, p)``, less those under gravity alone."""
        motion, plant, states = self.motion, self.plant, self.history
        modes = plant.rows.shape[2]
        rows, direct = plant.rows_of(watch.channels), plant.direct_of(watch.channels, self.inputs)
        added = [
            (self._added_rows(watch.channels, outputs), values)
            for outputs, values in (
                (watch.rates, states.rate),
                (watch.accelerations, states.acceleration),
            )
            if outputs
        ]
        observed = np.empty((len(motion.times), len(watch.channels)))
        for part in chunk_slices(len(motion.times)):
            moved = states.compliant[part] - motion.deflect(part)
            observed[part] = apply_matrices(motion.between(rows, part), moved[:, :modes])
            for others, values in added:
                observed[part] += apply_matrices(motion.between(others, part), values[part, :modes])
            observed[part] += apply_matrices(motion.between(direct, part), self.acting(part))
        return observed

    def _added_rows(
        self, channels: Sequence[Channel], outputs: Mapping[Channel, Channel]
    ) -> FloatArray:
        rows = np.zeros((len(self.motion.nodes), len(channels), self.plant.rows.shape[2]))
        some = [number for number, channel in enumerate(channels) if channel in outputs]
        rows[:, some] = self.plant.rows_of(outputs[channels[number]] for number in some)
        return rows


def follow_outputs(
    sampled: SampledMotion,
    times: FloatArray,
    *,
    outputs: Sequence[Channel],
    coordinates: FloatArray,
    acting: FloatArray,
    inputs: Sequence[Channel],
) -> FloatArray:
    """Return outputs ``(n, p)`` of a machine along its trajectory.

    Args:
        times: ``(n,)`` [s].
        outputs: Channels of the ``p`` outputs.
        coordinates: ``(n, m)`` modal coordinates then.
        acting: ``(n, k)`` values of inputs.
    """
    rows, columns = sampled.channels.rows.of(outputs), sampled.channels.columns.of(inputs)
    parts = []
    for part in chunk_slices(len(times)):
        plant = sampled.at(times[part], "rows", "direct")
        direct = plant.direct[:, rows][:, :, columns]
        parts.append(
            apply_matrices(plant.rows[:, rows], coordinates[part])
            + apply_matrices(direct, acting[part])
        )
    return np.concatenate(parts)
