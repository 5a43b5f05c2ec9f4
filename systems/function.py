"""Systems that are functions of their inputs, with numbers or with derivatives."""

from collections.abc import Callable, Collection, Mapping
from typing import Any, cast

from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems import framework
from pydrake.systems.framework import Context
from pydrake.systems.scalar_conversion import TemplateSystem

# Drake's stubs know no templates.
LeafSystem_ = cast(Any, framework).LeafSystem_


@TemplateSystem.define("FunctionSystem_", T_list=(float, AutoDiffXd))
def FunctionSystem_(T: type) -> type:  # noqa: N802, N803
    """Makes the class for a scalar type; `FunctionSystem` is that for numbers."""

    class Impl(LeafSystem_[T]):
        """Gives one vector, an arithmetic function of vectors.

        `ToAutoDiffXd` converts it, and with it a diagram of such systems, of `make_symbolic_policy`
        and of Drake's own: from the plant's state to the joints' targets, say. The whole loop does
        not convert:

        - Drake converts the plant without the actuators' PD law, and without a word. The
          derivatives would be another robot's, so `ActionHold`, which drives it, does not convert.
          And there are none of a box's contact with a half space.
        - `FootSensor`, `RewardMachineSystem`, `FallMonitor` and `AlternationSchedule` count and
          decide, and what `RewardSystem` earns for steps hangs on that.
        - `PolicySystem` and `StateEstimator` call networks and trees, which know numbers alone.

        For derivatives of the loop take finite differences of the plant's state, from one control
        instant to the next.
        """

        def _construct(
            self,
            inputs: Mapping[str, int],
            output: tuple[str, int],
            function: Callable[..., Any],
            optional: Collection[str] = (),
            converter: Any = None,
        ) -> None:
            """
            Args:
                inputs: Sizes of the input ports by name.
                output: Name and size of the output port.
                function: Maps vectors, by the names of their ports, to the output.
                optional: Ports that may stay unconnected; the function is called without them.
                converter: Drake's own.
            """
            LeafSystem_[T].__init__(self, converter=converter)
            self._declared = (inputs, output, function, optional)
            self._function = function
            ports = {name: self.DeclareVectorInputPort(name, size) for name, size in inputs.items()}
            self._needed = [(name, ports[name]) for name in inputs if name not in optional]
            self._optional = [(name, ports[name]) for name in inputs if name in optional]
            self.DeclareVectorOutputPort(
                *output, self._calc_output, prerequisites_of_calc={self.all_input_ports_ticket()}
            )

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, *other._declared, converter=converter)

        def _calc_output(self, context: Context, output: Any) -> None:
            values = {name: port.Eval(context) for name, port in self._needed}
            for name, port in self._optional:
                if port.HasValue(context):
                    values[name] = port.Eval(context)
            output.SetFromVector(self._function(**values))

    return Impl


FunctionSystem: Any = FunctionSystem_[float]
