"""A session with a board, by a program that knows docs/link.md and nothing else.

    python3 tests/external/link_client.py HOST:PORT

Self-test, soft start, an injection with a recording, garbled and old frames, soft
stop. Says what it saw; ends with 1 where the board does something else than the
document says.
"""

import cmath
import math
import os
import socket
import struct
import sys
import time
import zlib

MODES = ["Untested", "Testing", "Idle", "Starting", "Closed", "Stopping", "Failing", "Failed"]
REFUSALS = ["mode", "range", "frame", "version", "session", "replayed"]


def varint(value):
    out = bytearray()
    while True:
        byte, value = value & 0x7F, value >> 7
        out.append(byte | (0x80 if value else 0))
        if not value:
            return bytes(out)


def f32(value):
    return struct.pack("<f", value)


def cobs_encode(data):
    out, block = bytearray(), bytearray()
    for byte in data + b"\0":
        if byte == 0:
            out += bytes([len(block) + 1]) + block
            block.clear()
        else:
            block.append(byte)
            if len(block) == 254:
                out += bytes([255]) + block
                block.clear()
    return bytes(out)


def cobs_decode(data):
    out, at = bytearray(), 0
    while at < len(data):
        code = data[at]
        out += data[at + 1 : at + code]
        at += code
        if code < 255 and at < len(data):
            out.append(0)
    return bytes(out)


class Reader:
    def __init__(self, data):
        self.data, self.at = data, 0

    def byte(self):
        self.at += 1
        return self.data[self.at - 1]

    def u(self):
        value, shift = 0, 0
        while True:
            byte = self.byte()
            value |= (byte & 0x7F) << shift
            shift += 7
            if not byte & 0x80:
                return value

    def i(self):
        value = self.u()
        return (value >> 1) ^ -(value & 1)

    def f(self):
        self.at += 4
        return struct.unpack("<f", self.data[self.at - 4 : self.at])[0]

    def record(self):
        return [self.i() for _ in range(12)] + [self.u() for _ in range(6)]

    def report(self):
        at, mode, gain, target = self.u(), MODES[self.u()], self.f(), self.f()
        fault = None
        if self.byte():
            cause = self.u()
            mask = self.u() if 1 <= cause <= 4 else self.byte() if cause == 5 else None
            fault = (cause, mask, self.u())
        injecting, injected, recorded = self.u(), self.u(), self.u()
        done = (self.u(), self.u(), self.u()) if recorded == 3 else None
        counts = [self.u() for _ in range(4)]
        return dict(at=at, mode=mode, gain=gain, target=target, fault=fault,
                    injecting=injecting, injected=injected, done=done, counts=counts)


class Board:
    def __init__(self, where):
        host, port = where.rsplit(":", 1)
        self.line = socket.create_connection((host, int(port)), timeout=10)
        self.session = self.sequence = 0
        self.bytes = b""
        self.line.sendall(b"\0")
        nonce = int.from_bytes(os.urandom(4), "little")
        assert self.ask(0, varint(nonce))[0] == 0

    def packet(self, request, body=b"", session=None, sequence=None):
        session = self.session if session is None else session
        sequence = self.sequence if sequence is None else sequence
        return b"\x03" + varint(session) + varint(sequence) + varint(request) + body

    def send(self, packet):
        crc = zlib.crc32(packet).to_bytes(4, "little")
        self.line.sendall(cobs_encode(packet + crc) + b"\0")

    def receive(self):
        while b"\0" not in self.bytes:
            more = self.line.recv(4096)
            assert more, "the line has ended"
            self.bytes += more
        frame, self.bytes = self.bytes.split(b"\0", 1)
        data = cobs_decode(frame)
        packet, crc = data[:-4], data[-4:]
        assert zlib.crc32(packet).to_bytes(4, "little") == crc, "checksum"
        reader = Reader(packet)
        assert reader.byte() == 3, "version"
        return reader.u(), reader.u(), reader.u(), reader

    def ask(self, request, body=b""):
        self.sequence += 1
        self.send(self.packet(request, body))
        session, sequence, kind, reader = self.receive()
        assert sequence == self.sequence, "an answer has its request's sequence"
        self.session = session
        return kind, reader

    def done(self, request, body=b""):
        kind, reader = self.ask(request, body)
        assert kind == 3, f"refused: {REFUSALS[reader.u()] if kind == 4 else kind}"

    def refused(self, expected, packet):
        self.send(packet)
        _, _, kind, reader = self.receive()
        assert kind == 4 and REFUSALS[reader.u()] == expected, expected

    def report(self):
        kind, reader = self.ask(1)
        assert kind == 1
        report = reader.report()
        assert reader.at == len(reader.data), "bytes left over"
        return report

    def levels(self):
        kind, reader = self.ask(17)
        assert kind == 8
        window = reader.u()
        sensors, forces, legs = [[(reader.byte(), reader.byte()) for _ in range(6)] for _ in range(3)]
        limit, load = reader.byte(), reader.byte()
        assert reader.at == len(reader.data), "bytes left over"
        return window, sensors, forces, legs, limit, load

    def until(self, mode):
        while True:
            report = self.report()
            if report["mode"] == mode:
                return report
            assert report["fault"] is None, report
            time.sleep(0.01)


board = Board(sys.argv[1])
kind, reader = board.ask(2)
assert kind == 2
layout, model = reader.u(), bytes(reader.byte() for _ in range(32))
checksum, rate, room = reader.u(), reader.f(), reader.u()
assert reader.byte() == 0, "a fresh board runs the table compiled in"
print(f"table {checksum:08x}, layout {layout}, {rate:.0f} Hz, room for {room}, model {model.hex()[:16]}")

before = board.report()
board.sequence += 1
good = board.packet(3)
bad = bytes([good[0] ^ 2]) + good[1:]
board.refused("version", bad)
board.refused("session", board.packet(3, session=board.session ^ 1))
board.refused("replayed", board.packet(3, sequence=board.sequence - 1))
garbled = bytearray(cobs_encode(good + zlib.crc32(good).to_bytes(4, "little")))
garbled[-1] ^= 0x55
board.line.sendall(bytes(b or 1 for b in garbled) + b"\0")
_, _, kind, reader = board.receive()
assert kind == 4 and REFUSALS[reader.u()] == "frame"
after = board.report()
assert after["mode"] == before["mode"] == "Untested", "bad frames change nothing"
print("garbled, old and foreign frames are refused and change nothing")

board.done(3)
board.until("Idle")
print("self-test passed")
board.done(9, varint(2) + varint(5) + varint(200))  # on an injection
armed = board.report()["at"]
while board.report()["at"] < armed + 5:  # there must be something from before it
    time.sleep(0.001)
legs = b"".join(f32(x) for x in [10.0, 0, 0, 0, 0, 0])
board.done(8, varint(0) + f32(500.0) + legs + varint(400))  # a sine
while board.report()["done"] is None:
    time.sleep(0.01)
records = []
while True:
    kind, reader = board.ask(10, varint(len(records)))
    count = reader.u()
    records += [reader.record() for _ in range(count)]
    if not count:
        break
peak = max(r[12] for r in records) - 32768
print(f"recorded {len(records)}, leg 1 up to {peak} codes")
assert len(records) == 205 and peak > 1000 and all(r[13] == 32768 for r in records)
# A sine of 50 Hz over a window: 10 N of the limit; 20·log10(√2) = 3 dB from peak to rms. Ten
# windows, so that the one that is read is whole even if this program is kept waiting for a second.
board.done(8, varint(0) + f32(50.0) + legs + varint(10 * 5035))
begun = board.levels()[0]
while board.levels()[0] < begun + 2:
    time.sleep(0.01)
_, sensors, forces, outputs, limit, load = board.levels()
rms, crest = outputs[0]
amplitude = 10 ** (-crest / 40) * 32768
print(f"leg 1 {-rms / 2} dB, peak {-crest / 2} dB: {amplitude:.0f} codes; {limit} % of the limit")
assert abs(amplitude / peak - 1) < 0.03 and rms - crest in (5, 6, 7)
assert all(level == (255, 255) for level in outputs[1:]), "the other legs are at rest"
assert all(rms < 255 and rms >= crest for rms, crest in sensors)
assert all(level == (255, 255) for level in forces) and load == 0
while board.report()["injecting"]:
    time.sleep(0.01)
turns = [3, 17]
lines = b"".join(varint(t) + f32(1.0 + k) for k, t in enumerate(turns))
board.done(18, bytes([12]) + varint(len(turns)) + lines)
board.done(8, varint(2) + legs + varint(2 * 4096 + 15))  # the multisine
while board.report()["injecting"]:
    time.sleep(0.01)
for k, t in enumerate(turns):
    kind, reader = board.ask(19, bytes([k]))
    windows = reader.u()
    parts = [complex(reader.f(), reader.f()) for _ in range(18)]
    assert (kind, windows) == (9, 2)
    # Re(X·e^(jωt)) is 10·(1 + k)·sin(ωt − πk²/2), N; codes per newton are the table's.
    expected = 10.0 * (1 + k) * cmath.exp(-1j * math.pi * (k * k / 2 + 0.5))
    ratio = parts[12] / expected
    assert abs(ratio.imag) < 1e-3 * ratio.real, (k, ratio)
    assert all(abs(part) < 1e-3 * abs(parts[12]) for part in parts[13:]), "other legs"
    print("line", k, "of the multisine:", round(abs(parts[12])), "codes")
board.done(4)
print("closed at", board.until("Closed")["at"])
kind, reader = board.ask(4)
assert kind == 4 and REFUSALS[reader.u()] == "mode", "a closed loop is not started"
kind, reader = board.ask(7, f32(float("nan")))
assert kind == 4 and REFUSALS[reader.u()] == "range"
board.done(12, varint(1000))
session, sequence, kind, reader = board.receive()
assert (kind, sequence) == (6, 0), "telemetry"
print("telemetry of sample", reader.u(), MODES[reader.u()])
board.line.sendall(b"")
board.sequence += 1
board.send(board.packet(12, varint(0)))
while board.receive()[1] != board.sequence:
    pass
board.done(5)
print("stopped at", board.until("Idle")["at"])
