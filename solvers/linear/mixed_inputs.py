"""Inputs of a frequency response that act by several loads: set points by the forces of drives,
displacements by what springs, dampers and inertia push.
"""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.linear.frequency_response import FrfModel
from headstock.solvers.linear.response_forms import ResponseForm
from headstock.solvers.second_order import Channel, ComplexArray


@dataclass(frozen=True, eq=False)
class MixedInput:
    """One of them.

    Attributes:
        loads: Channels of the ``p`` loads that it makes.
        weigh: Angular frequencies ``(n_freq,)``, also 0, to the loads ``(n_freq, p)`` per unit of it;
            NaN where they have no limit.
        direct: Output to what the input and its rate move there by themselves; all others nothing.
    """

    loads: tuple[Channel, ...]
    weigh: Callable[[FloatArray], ComplexArray]
    direct: Mapping[Channel, tuple[float, float]] = dataclasses.field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class InputMix:
    """Inputs of a response, of which some are mixed."""

    inputs: tuple[Channel, ...]
    mixed: Mapping[Channel, MixedInput]

    @functools.cached_property
    def loads(self) -> tuple[Channel, ...]:
        """Loads of all inputs: the first of each in their order, then the others."""
        firsts = [self.mixed[one].loads[0] if one in self.mixed else one for one in self.inputs]
        return (*firsts, *(load for one in self._mixed for load in self.mixed[one].loads[1:]))

    @property
    def _mixed(self) -> list[Channel]:
        return [one for one in self.inputs if one in self.mixed]

    def weigh(self, omega: FloatArray) -> ComplexArray:
        """Return the loads ``(n_freq, n_loads, n_inputs)`` of unit inputs at angular frequencies."""
        count = len(self.inputs)
        weights = np.zeros((len(omega), len(self.loads), count), dtype=complex)
        weights[:, np.arange(count), np.arange(count)] = 1.0
        further = count
        for one in self._mixed:
            values, column = self.mixed[one].weigh(omega), self.inputs.index(one)
            last = further + values.shape[1] - 1
            weights[:, [column, *range(further, last)], column] = values
            further = last
        return weights

    def pass_on(self, outputs: tuple[Channel, ...]) -> FloatArray:
        """Return what inputs and their rates move at once ``(2, n_outputs, n_inputs)``."""
        direct = np.zeros((2, len(outputs), len(self.inputs)))
        for one in self._mixed:
            for row, output in enumerate(outputs):
                direct[:, row, self.inputs.index(one)] = self.mixed[one].direct.get(output, 0.0)
        return direct

    def apply(self, model: FrfModel, at_rest: Mapping[Channel, FloatArray]) -> FrfModel:
        """Return a model of these inputs.

        Args:
            model: Of their loads.
            at_rest: Input to its response at rest ``(n_outputs,)``, where its loads have no limit.
        """
        direct = self.pass_on(model.outputs)
        resting = model.at_rest @ self.weigh(np.zeros(1)).real[0] + direct[0]
        for one, values in at_rest.items():
            resting[:, self.inputs.index(one)] = values
        linked = None
        if model.linked is not None:
            acting = self.weigh(np.ones(1))[0] != 0.0
            linked = (model.linked.astype(float) @ acting > 0.0) | direct.any(axis=0)
        form = MixedResponse(model.form, self, direct)
        return dataclasses.replace(
            model, inputs=self.inputs, form=form, at_rest=resting, linked=linked
        )


@dataclass(frozen=True, eq=False)
class MixedResponse:
    """The response of a form to mixed inputs.

    Attributes:
        form: Its response to their loads.
        direct: ``(2, n_outputs, n_inputs)`` what inputs and their rates move at once.
    """

    form: ResponseForm
    mix: InputMix
    direct: FloatArray

    def evaluate(self, omega: FloatArray) -> ComplexArray:
        """Return the response ``(n_freq, n_outputs, n_inputs)`` at positive angular frequencies."""
        passed = self.direct[0] + 1j * omega[:, None, None] * self.direct[1]
        return self.form.evaluate(omega) @ self.mix.weigh(omega) + passed

    def poles(self) -> ComplexArray:
        """Return the poles of the form [rad/s]."""
        return self.form.poles()
