#!/usr/bin/env python3
"""pymodbus as the master of a board: reads, runs it to a target, changes the target, stops it.

target/python/venv/bin/python3 tests/clients/board.py TERMINAL UNIT
target/python/venv/bin/python3 tests/clients/board.py HOST:PORT UNIT
"""

import sys
import time

from pymodbus.client import ModbusSerialClient, ModbusTcpClient

CONTROL, KIND, STATUS, STATE, FIRST_SETTING = 0, 1, 4, 5, 100
READY, HELD = 1 << 0, 1 << 8

address, unit = sys.argv[1], int(sys.argv[2])
host, _, port = address.partition(":")
# A terminal without a line has no parity. The board may still start.
if port:
    master = ModbusTcpClient(host, port=int(port), timeout=5, retries=10)
else:
    master = ModbusSerialClient(address, baudrate=19200, parity="N", timeout=5, retries=10)
assert master.connect(), address


def answer(response):
    assert not response.isError(), response
    return response


def read(address, count=1):
    return answer(master.read_holding_registers(address, count=count, device_id=unit)).registers


def write(address, *words):
    answer(master.write_registers(address, list(words), device_id=unit))


def to_float(words):
    return master.convert_from_registers(words, master.DATATYPE.FLOAT32)


def wait(bits, value):
    end = time.monotonic() + 100
    while read(STATUS)[0] & bits != value:
        assert time.monotonic() < end, read(0, 10)
        time.sleep(0.05)


frequency = to_float(read(FIRST_SETTING, 2))
assert frequency == 50.0, frequency
assert answer(
    master.read_input_registers(FIRST_SETTING, count=2, device_id=unit)
).registers == read(FIRST_SETTING, 2)
names = answer(master.read_device_information(device_id=unit)).information
assert names[0] == b"kband" and names[1] == b"feeder" and names[2], names
assert answer(master.diag_query_data(b"\xa5\x5a", device_id=unit)).message == b"\xa5\x5a"

refused = master.read_holding_registers(99, count=1, device_id=unit)
assert refused.exception_code == 2, refused
refused = master.write_registers(KIND, [36, 0, 0], device_id=unit)
assert refused.exception_code == 3, refused

wait(READY, READY)
write(CONTROL, 0)
write(KIND, 32, *master.convert_to_registers(0.8, master.DATATYPE.FLOAT32))
answer(master.write_register(CONTROL, 1, device_id=unit))
wait(HELD, HELD)
refused = master.write_registers(
    FIRST_SETTING, master.convert_to_registers(60.0, master.DATATYPE.FLOAT32), device_id=unit
)
assert refused.exception_code == 6, refused
write(KIND, 33, *master.convert_to_registers(0.1, master.DATATYPE.FLOAT32))
end = time.monotonic() + 100
while abs((amplitude := to_float(read(34, 2))) - 0.1) >= 0.005:
    assert time.monotonic() < end, amplitude
    time.sleep(0.05)
wait(HELD, HELD)
write(CONTROL, 0)
wait(2, 0)
print("pymodbus: held 0.8 of k, then", amplitude, "mm")
