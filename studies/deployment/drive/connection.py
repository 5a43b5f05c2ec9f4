"""Opening LCM."""

import time

from pydrake.lcm import DrakeLcm

from glassgait.models.errors import InputError, shown
from glassgait.models.link.settings import LinkSettings

PATIENCE = 2.0
"""Time in which a message that is sent here must come back (s)."""


def open_lcm(link: LinkSettings) -> DrakeLcm:
    """Opens LCM, and tries whether messages come through.

    Drake goes on without a word where a URL cannot be used, and messages go nowhere.

    Raises:
        InputError: if a message does not come back.
    """
    lcm = DrakeLcm(link.lcm_url)
    # On a channel of its own moment, so that others that start now do not answer in its place.
    channel, heard = f"{link.channels}PROBE_{time.time_ns()}", []
    subscription = lcm.Subscribe(channel, heard.append)
    end = time.monotonic() + PATIENCE
    while not heard and time.monotonic() < end:
        lcm.Publish(channel, b"probe")
        lcm.HandleSubscriptions(100)
    del subscription
    if not heard:
        raise InputError(
            f"link: no message comes through at {shown(link.lcm_url)}; check that this machine "
            "takes multicast on its loopback, that a server of tcpq runs, or give another --lcm-url"
        )
    return lcm
