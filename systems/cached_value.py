"""Values that several ports and an update need, and that are computed once."""

from collections.abc import Callable, Collection
from typing import Generic, TypeVar

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, DependencyTicket, LeafSystem, ValueProducer

T = TypeVar("T")


class CachedValue(Generic[T]):
    """A cache entry of a system, of any type."""

    def __init__(
        self,
        system: LeafSystem,
        description: str,
        calc: Callable[[Context], T],
        prerequisites: Collection[DependencyTicket],
    ) -> None:
        """
        Args:
            system: The system that declares the entry.
            description: What it holds.
            calc: Computes it from the system's context.
            prerequisites: What it is computed from.
        """

        def put(context: Context, value: AbstractValue) -> None:
            value.set_value(calc(context))

        self._entry = system.DeclareCacheEntry(
            description=description,
            value_producer=ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=put),
            prerequisites_of_calc=set(prerequisites),
        )

    def Eval(self, context: Context) -> T:  # noqa: N802
        """Returns the value, computed if what it depends on has changed."""
        return self._entry.Eval(context)

    def ticket(self) -> DependencyTicket:
        """Returns the ticket of what depends on it."""
        return self._entry.ticket()
