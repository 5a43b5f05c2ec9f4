"""Whether EGL can render here, asked before VTK is: without a driver it ends the process."""

import ctypes
import sys

from glassgait.models.errors import InputError

_PLATFORM_DEVICE = 0x313F
"""EGL_PLATFORM_DEVICE_EXT."""

_MOST_DEVICES = 16

_POINTER = ctypes.c_void_p


def check_egl() -> None:
    """Opens a display of some device, as VTK does.

    Raises:
        InputError: if EGL's library is missing, or no driver behind it.
    """
    if sys.platform == "linux" and not _opens_display():
        raise InputError(
            "rendering: EGL cannot open a display; install it with a driver (Debian: libegl1 and "
            "libgl1-mesa-dri), or do not render"
        )


def _opens_display() -> bool:
    try:
        library = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return False
    find = ctypes.CFUNCTYPE(_POINTER, ctypes.c_char_p)(("eglGetProcAddress", library))
    number, out = ctypes.c_uint, ctypes.POINTER
    signatures = {
        b"eglQueryDevicesEXT": (number, ctypes.c_int, _POINTER * _MOST_DEVICES, out(ctypes.c_int)),
        b"eglGetPlatformDisplayEXT": (_POINTER, number, _POINTER, _POINTER),
        b"eglInitialize": (number, _POINTER, _POINTER, _POINTER),
    }
    addresses = [find(name) for name in signatures]
    if not all(addresses):
        return False
    query_devices, get_display, initialize = (
        ctypes.CFUNCTYPE(*types)(address)
        for types, address in zip(signatures.values(), addresses, strict=True)
    )
    devices, count = (_POINTER * _MOST_DEVICES)(), ctypes.c_int()
    query_devices(_MOST_DEVICES, devices, ctypes.byref(count))
    displays = (get_display(_PLATFORM_DEVICE, device, None) for device in devices[: count.value])
    return any(initialize(display, None, None) for display in displays)
