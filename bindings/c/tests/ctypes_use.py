"""The C interface through ctypes. Arguments: the library, a scene file."""

import ctypes
import sys
from ctypes import byref, c_char_p, c_double, c_float, c_int, c_size_t, c_uint16, c_void_p

library = ctypes.CDLL(sys.argv[1])
library.kband_version.restype = c_char_p
library.kband_error.restype = c_size_t


class Band(ctypes.Structure):
    """As kband_band_of_lot."""

    _fields_ = [("low", c_double), ("high", c_double), ("setpoint", c_double)]


class Output(ctypes.Structure):
    """As kband_output."""

    _fields_ = [("output", c_float), ("step", ctypes.c_uint32), ("wrapped", ctypes.c_bool)]


def why():
    """Why the last call failed."""
    buffer = ctypes.create_string_buffer(1024)
    library.kband_error(buffer, c_size_t(len(buffer)))
    return buffer.value.decode()


assert library.kband_version().count(b".") == 2
band = Band()
assert library.kband_band(c_double(0.18), c_double(0.22), 1, byref(band)) == 0
assert 0.407 < band.low < band.setpoint < band.high < 0.459
assert library.kband_band(c_double(1.8), c_double(1.9), 1, byref(band)) == 2
assert "1.8 is refused; accepted: 0..1" in why(), why()

with open(sys.argv[2], "rb") as file:
    text = file.read()
scene, plant, signal = c_void_p(), c_void_p(), c_void_p()
assert library.kband_scene_parse(text, c_size_t(len(text)), byref(scene)) == 0, why()
assert library.kband_plant_new(scene, byref(plant)) == 0, why()
assert library.kband_signal_new(scene, byref(signal)) == 0, why()
cycles, code, output = 0, c_uint16(), Output()
for _ in range(4000):
    assert library.kband_plant_sample(plant, byref(code), None) == 0
    assert library.kband_signal_sample(signal, code, c_uint16(0), byref(output)) == 0
    assert library.kband_plant_hold(plant, c_float(output.output), c_int(output.step)) == 0
    cycles += output.wrapped
assert cycles == 9 or cycles == 10, cycles
for free, handle in (("signal", signal), ("plant", plant), ("scene", scene)):
    getattr(library, f"kband_{free}_free")(handle)
print("ctypes: ok")
