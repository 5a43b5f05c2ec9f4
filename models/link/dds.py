"""DDS, Unitree's way of carrying messages: one topic that is heard, and one that is sent on.

Cyclone DDS comes with the extra `unitree`. Of its Python package the types and the transport are
used; bytes are read and written by `unitree_messages`.
"""

import re
import time
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, NamedTuple, Protocol

import numpy as np
from annotated_types import Ge, Le

from glassgait.models.errors import InputError, shown
from glassgait.models.link.unitree_messages import LOW_CMD, LOW_STATE, MessageType, Record
from glassgait.models.settings import Settings

STATES, COMMANDS = "rt/lowstate", "rt/lowcmd"
"""Unitree's topics: what the robot senses, and what its motors are to do."""

KEPT = 1024
"""Messages that are kept until they are heard: of two seconds at 500 Hz."""

_INTERFACE = re.compile(r"[A-Za-z0-9_.:-]{1,15}")

_CONFIGURATION = """<CycloneDDS><Domain Id="any"><General><Interfaces>
<NetworkInterface name="{}" priority="default" multicast="default"/>
</Interfaces></General></Domain></CycloneDDS>"""


@dataclass(frozen=True)
class DdsSettings(Settings):
    """Where Unitree's messages go.

    Attributes:
        domain: Number of the DDS domain. A robot's is 0; the default, 1, is not.
        interface: The network interface; by default the loopback, which no message leaves.
    """

    title: ClassVar[str] = "dds"

    domain: Annotated[int, Ge(0), Le(232)] = 1
    interface: str = "lo"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not _INTERFACE.fullmatch(self.interface):
            raise InputError(
                f"dds: interface is {shown(self.interface)}; name one of `ip link`, such as lo"
            )


class Heard(NamedTuple):
    """A message that came.

    Attributes:
        message: The message, the very one of before where its bytes are the same; None if they are
            none of its type.
        publisher: The number of its publisher.
        age: Time since it was sent (s), but for the difference of two machines' clocks.
    """

    message: Record | None
    publisher: int
    age: float = 0.0


class Endpoint(Protocol):
    """Where a process hears messages of one kind, and sends those of another."""

    def take(self, wait: float = 0.0) -> list[Heard]:
        """Returns what came since the last call, in order.

        Args:
            wait: Time to wait for the first one where none came (s).
        """
        ...

    def send(self, message: Record) -> None:
        """Sends a message."""
        ...


class DdsEndpoint:
    """An end of the link over DDS."""

    def __init__(
        self,
        settings: DdsSettings,
        *,
        hears: tuple[str, MessageType],
        sends: tuple[str, MessageType],
    ) -> None:
        """
        Args:
            settings: Where messages go.
            hears: Topic and type of the messages that are heard.
            sends: Topic and type of those that are sent.

        Raises:
            InputError: if the extra `unitree` is not installed, or the interface cannot be used.
        """
        try:
            from cyclonedds.core import (  # noqa: PLC0415
                DDSException,
                InstanceState,
                ReadCondition,
                SampleState,
                ViewState,
                WaitSet,
            )
            from cyclonedds.domain import DomainParticipant  # noqa: PLC0415
            from cyclonedds.pub import DataWriter  # noqa: PLC0415
            from cyclonedds.qos import Policy, Qos  # noqa: PLC0415
            from cyclonedds.sub import DataReader  # noqa: PLC0415
            from cyclonedds.topic import Topic  # noqa: PLC0415
        except ImportError as missing:
            raise InputError(
                "wire unitree: needs Cyclone DDS; pip install -e '.[unitree]'"
            ) from missing
        try:
            _open_domain(settings.domain, settings.interface)
            participant = DomainParticipant(settings.domain)
        except DDSException as error:
            raise InputError(
                f"dds: interface {shown(settings.interface)} cannot be used in domain "
                f"{settings.domain} ({error.msg}); name another one of `ip link`"
            ) from error
        self._hears = hears[1]
        self._data: bytes | None = None
        self._message: Record | None = None
        kept = Qos(Policy.History.KeepLast(KEPT))
        topic, own = (Topic(participant, name, _idl_type(kind)) for name, kind in (hears, sends))
        self._reader = DataReader(participant, topic, kept)
        self._writer = DataWriter(participant, own, kept)
        self._sends = sends[1], own.data_type
        anything = SampleState.Any | ViewState.Any | InstanceState.Any
        self._condition = ReadCondition(self._reader, anything)
        self._waiting = WaitSet(participant)
        self._waiting.attach(self._condition)

    def take(self, wait: float = 0.0) -> list[Heard]:
        """Returns what came since the last call, as `Endpoint` has it."""
        if wait > 0.0:
            self._waiting.wait(timeout=round(1e9 * wait))
        return [self._read(sample) for sample in self._reader.take(N=KEPT)]

    def send(self, message: Record) -> None:
        """Sends a message."""
        kind, sample_type = self._sends
        sample = object.__new__(sample_type)
        sample.data = kind.to_wire(message)
        self._writer.write(sample)

    def _read(self, sample: Any) -> Heard:
        data = getattr(sample, "data", b"")
        if data != self._data:
            try:
                self._message = self._hears.from_wire(data)
            except ValueError:
                self._message = None
            self._data = data
        info = sample.sample_info
        return Heard(
            self._message, info.publication_handle, time.time() - 1e-9 * info.source_timestamp
        )


def open_controllers_end(settings: DdsSettings) -> DdsEndpoint:
    """Opens the end that hears what a robot senses, and commands its motors; see `DdsEndpoint`."""
    return DdsEndpoint(settings, hears=(STATES, LOW_STATE), sends=(COMMANDS, LOW_CMD))


def open_robots_end(settings: DdsSettings) -> DdsEndpoint:
    """Opens the other end."""
    return DdsEndpoint(settings, hears=(COMMANDS, LOW_CMD), sends=(STATES, LOW_STATE))


@cache
def _open_domain(domain: int, interface: str) -> object:
    """Opens a domain on one interface, once a process; it closes with what is returned."""
    from cyclonedds.domain import Domain  # noqa: PLC0415

    return Domain(domain, _CONFIGURATION.format(interface))


@cache
def _idl_type(kind: MessageType) -> Any:
    """Makes the type by which Cyclone DDS matches topics; it passes bytes through."""
    made = idl_struct(kind)

    def deserialize(data: bytes, *_: Any, **__: Any) -> Any:
        sample = object.__new__(made)
        sample.data = bytes(data)
        return sample

    def serialize(self: Any, *_: Any, **__: Any) -> bytes:
        return self.data

    made.deserialize, made.deserialize_key = deserialize, deserialize
    made.serialize = serialize
    return made


def idl_struct(kind: MessageType) -> Any:
    """Makes Cyclone DDS's type of a message, which reads and writes each field for itself."""
    from cyclonedds.idl import annotations, make_idl_struct, types  # noqa: PLC0415

    fields = {}
    for name in kind.dtype.names or ():
        dtype = kind.dtype[name]
        scalar, shape = dtype.subdtype or (dtype, ())
        if name in kind.parts:
            element = idl_struct(kind.parts[name])
        else:
            element = getattr(types, np.dtype(scalar).name)
        fields[name] = types.array[element, shape[0]] if shape else element
    made = make_idl_struct(kind.name.rpartition(".")[2], kind.name, fields)
    return annotations.final(annotations.autoid("sequential")(made))
