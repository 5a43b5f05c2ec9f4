"""Base classes of the leaf systems: named ports around one function that computes all outputs."""

from abc import abstractmethod
from collections.abc import Collection, Mapping
from functools import partial

from numpy.typing import ArrayLike
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State, ValueProducer

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD

STATE = quadruped.N_POSITIONS + quadruped.N_VELOCITIES  # length of the plant's state

Outputs = Mapping[str, ArrayLike]  # port name to vector


class FunctionSystem(LeafSystem):
    """Computes its outputs from its inputs, without state."""

    def __init__(
        self, inputs: Mapping[str, int], outputs: Mapping[str, int], optional: Collection[str] = ()
    ) -> None:
        """Declares ports of the given sizes.

        Optional inputs may stay unconnected; `evaluate` is then called without them.
        """
        super().__init__()
        self._optional = frozenset(optional)
        self._ports = {
            name: self.DeclareVectorInputPort(name, size) for name, size in inputs.items()
        }
        # Without the cache entry, Drake would call the function once per output.
        self._entry = self.DeclareCacheEntry(
            description="outputs",
            value_producer=ValueProducer(lambda: AbstractValue.Make(object()), self._calc),
            prerequisites_of_calc={self.all_input_ports_ticket(), self.xd_ticket()},
        )
        for name, size in outputs.items():
            self.DeclareVectorOutputPort(
                name=name,
                size=size,
                calc=partial(self._put, name),
                prerequisites_of_calc={self._entry.ticket()},
            )

    @abstractmethod
    def evaluate(self, **inputs: Array) -> Outputs:
        """Returns the outputs by name."""

    def _calc(self, context: Context, value: AbstractValue) -> None:
        value.set_value(self.evaluate(**self._inputs(context)))

    def _outputs(self, context: Context) -> Outputs:
        return self._entry.Eval(context)

    def _inputs(self, context: Context) -> dict[str, Array]:
        return {
            name: port.Eval(context)
            for name, port in self._ports.items()
            if name not in self._optional or port.HasValue(context)
        }

    def _put(self, name: str, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._outputs(context)[name])


class MealySystem(FunctionSystem):
    """Computes its outputs from its inputs and a state vector, its memory.

    The memory is latched every 20 ms in an unrestricted update, which precedes the plant's discrete
    update of the same instant.
    """

    def __init__(
        self,
        inputs: Mapping[str, int],
        outputs: Mapping[str, int],
        memory: ArrayLike,
        optional: Collection[str] = (),
    ) -> None:
        """Declares ports as `FunctionSystem` does, and the initial memory."""
        super().__init__(inputs, outputs, optional)
        self._memory = self.DeclareDiscreteState(memory)
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

    @abstractmethod
    def step(self, memory: Array, **inputs: Array) -> tuple[Outputs, ArrayLike]:
        """Returns the outputs by name, and the memory for the next control step."""

    def memory(self, context: Context) -> Array:
        """Returns the memory of the previous control step."""
        return context.get_discrete_state(self._memory).value()

    def _calc(self, context: Context, value: AbstractValue) -> None:
        value.set_value(self.step(self.memory(context), **self._inputs(context)))

    def _outputs(self, context: Context) -> Outputs:
        return self._entry.Eval(context)[0]

    def _latch(self, context: Context, state: State) -> None:
        after = self._entry.Eval(context)[1]
        state.get_mutable_discrete_state(self._memory).SetFromVector(after)
