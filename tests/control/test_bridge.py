"""The bridge to a robot: packets, clocks, links, watchdogs on both sides, and the firmware of a microcontroller."""

from __future__ import annotations

import importlib.util
import itertools
import math
import multiprocessing
import os
import signal
import struct
import subprocess
import sys
import threading
import time
import tty
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.random import Generator
from numpy.testing import assert_allclose, assert_array_equal

from control.bridge import packets
from control.bridge.board import STATES, Board
from control.bridge.bridge import Bridge, NoRobotError, drive
from control.bridge.clock import ClockOffset
from control.bridge.deadlines import following
from control.bridge.exchange import ControllerSide
from control.bridge.links import Impaired, Received, Serial, Udp, opened
from control.bridge.packets import (
    CHANNELS,
    COMMANDED,
    PARTS,
    RESTING,
    Inbox,
    Kind,
    Packet,
    Refusal,
    decoded,
    encoded,
    next_packet,
    shape,
)  # fmt: skip
from control.bridge.robot import WATCHDOG, Robot, RobotSide, serve
from control.sensing.sensors import QUANTITIES
from worm3d import Command, Worm

N = 3
TO_ROBOT = {Kind.BEGIN: (), Kind.COMMAND: COMMANDED, Kind.REST: ()}
FIRMWARE = Path(packets.__file__).parent / "firmware" / "worm.py"


def values(random: Generator, *names: str, segments: int = N) -> dict[str, Any]:
    return {name: random.uniform(-0.5, 0.5, shape(name, segments)).astype("<f4").astype(float) for name in names}


def command(number: int, session: int = 5, **more: Any) -> Packet:
    return Packet(Kind.COMMAND, session, number, 1.0, values(np.random.default_rng(number), *COMMANDED), **more)


class TestPackets:
    def test_channels_are_those_of_the_sensors(self) -> None:
        for name in CHANNELS:
            assert shape(name, 6) == QUANTITIES[name].shape(Worm())

    @pytest.mark.parametrize("segments", [1, 2, 6, 40])
    @pytest.mark.parametrize("names", [(), COMMANDED, CHANNELS, ("com",), ("heading", "pressure")])
    def test_a_packet_comes_back(self, names: tuple[str, ...], segments: int) -> None:
        given = values(np.random.default_rng(1), *names, segments=segments)
        sent = Packet(Kind.SAMPLE, 2**32 - 1, 7, 12.345678, given, RESTING, 1e6, 3.000001, 12.3)
        found = decoded(encoded(sent, segments), segments)
        assert isinstance(found, Packet)
        plain = [name for name in Packet._fields if name != "values"]
        assert [getattr(found, name) for name in plain] == pytest.approx(
            [getattr(sent, name) for name in plain], abs=1e-9
        )
        assert found.values.keys() == given.keys()
        for name, value in given.items():
            assert_array_equal(found.values[name], value)

    def test_the_layout_is_the_documented_one(self) -> None:
        body = b"WORM" + bytes([1, 4, 1, 0, 2, 0, 0b1000, 0])  # version, SAMPLE, resting, 2 segments, com
        body += (9).to_bytes(4, "little") + (3).to_bytes(4, "little")
        body += b"".join(each.to_bytes(8, "little") for each in (1_500_000, 20, 30, 1_400_000))
        body += struct.pack("<3f", 0.5, -0.25, 2.0)
        sent = Packet(Kind.SAMPLE, 9, 3, 1.5, {"com": np.array([0.5, -0.25, 2.0])}, RESTING, 2e-5, 3e-5, 1.4)
        assert encoded(sent, 2) == body + zlib.crc32(body).to_bytes(4, "little")

    @pytest.mark.parametrize(
        ("data", "why"),
        [
            (b"", Refusal.LENGTH),
            (encoded(command(1), N)[:30], Refusal.LENGTH),
            (encoded(command(1), N + 1), Refusal.SEGMENTS),
            (encoded(command(1)._replace(session=6), N), Refusal.SESSION),
            (encoded(command(0), N), Refusal.OLD),
            (encoded(command(1)._replace(values={"contraction": np.zeros((N, 2))}), N), Refusal.KIND),
            (encoded(command(1)._replace(kind=Kind.SAMPLE), N), Refusal.KIND),
            (encoded(command(1)._replace(values={"hinge": [0, np.nan], "contraction": [0] * 6}), N), Refusal.VALUE),
            (encoded(command(1)._replace(values={"hinge": [0, 0], "contraction": [1] * 6}), N), Refusal.VALUE),
        ],
    )  # fmt: skip
    def test_a_wrong_packet_is_refused_and_counted(self, data: bytes, why: Refusal) -> None:
        inbox = Inbox(N, TO_ROBOT)
        inbox.open(5)
        assert inbox.take(encoded(command(0), N)) is not None
        assert inbox.take(data) is None
        assert inbox.refused == {why: 1}
        assert inbox.take(encoded(command(1), N)) is not None

    @pytest.mark.parametrize(
        ("place", "byte", "why"), [(0, 0, Refusal.FOREIGN), (4, 2, Refusal.VERSION), (5, 9, Refusal.KIND)]
    )
    def test_another_protocol_is_named(self, place: int, byte: int, why: Refusal) -> None:
        body = bytearray(encoded(command(1), N)[:-4])
        body[place] = byte
        assert decoded(bytes(body) + zlib.crc32(body).to_bytes(4, "little"), N) is why

    def test_each_wrong_bit_is_noticed(self) -> None:
        good = encoded(command(1), N)
        for bit in range(8 * len(good)):
            bad = bytearray(good)
            bad[bit // 8] ^= 1 << bit % 8
            assert isinstance(decoded(bytes(bad), N), Refusal), f"bit {bit}"

    def test_thousands_of_bad_packets_are_refused_and_counted(self) -> None:
        random = np.random.default_rng(0)
        inbox, side = Inbox(N, TO_ROBOT), RobotSide(Recorder(), Wire())
        inbox.open(5)
        side.take(encoded(Packet(Kind.BEGIN, 5, 0), N), None, 0.0)
        good = [encoded(command(k), N) for k in range(20)]
        for data in good:
            assert inbox.take(data) is not None
            side.take(data, None, 0.0)
        for k in range(6000):
            data = good[k % 20]  # a replay
            if k % 5 == 1:
                data = data[: random.integers(len(data))]
            elif k % 5 == 2:
                data = data + random.bytes(int(random.integers(1, 40)))
            elif k % 5 == 3:
                data = random.bytes(int(random.integers(200)))
            elif k % 5 == 4:
                part = bytearray(data)
                part[int(random.integers(len(data)))] ^= int(random.integers(1, 256))
                data = bytes(part)
            assert inbox.take(data) is None
            side.take(data, ("elsewhere", 1), 1.0)
        assert inbox.refused.total() == side.inbox.refused.total() == 6000
        assert (inbox.accepted, side.inbox.accepted) == (20, 21)
        assert inbox.refused[Refusal.OLD] == 1200
        assert side.link.peer is None, "answers a stranger"

    def test_packets_are_found_on_a_noisy_line(self) -> None:
        random = np.random.default_rng(3)
        sent = [encoded(command(k), N) for k in range(300)]
        noise = [b"", b"WORM", b"WO", random.bytes(7), sent[0][:70], b"WORM" + random.bytes(30)]
        line = b"".join(noise[k % 6] + data for k, data in enumerate(sent)) + bytes(packets.LARGEST)
        found, rest = [], b""
        while line:
            cut = int(random.integers(1, 200))
            rest, line = rest + line[:cut], line[cut:]
            packet, rest = next_packet(rest)
            while packet:
                found.append(packet)
                packet, rest = next_packet(rest)
        assert found == sent
        assert len(rest) < packets.LARGEST

    def test_a_damaged_length_holds_nothing_back(self, firmware: ModuleType) -> None:
        six = TestFirmware.SIX
        good = encoded(Packet(Kind.COMMAND, 8, 1, 2.0, values(np.random.default_rng(1), *COMMANDED, segments=six)), six)
        head = [*packets.HEADER.unpack_from(good)]
        for place, value in ((4, 900), (5, 0xFF)):  # segments, and parts
            damaged = packets.HEADER.pack(*head[:place], value, *head[place + 1 :]) + good[packets.HEADER.size :]
            packet, rest = next_packet(damaged)
            assert packet == b""
            assert next_packet(rest + good) == (good, b"")
            header, _, rest = firmware.next_packet(damaged)
            assert header is None
            header, _, rest = firmware.next_packet(rest + good)
            assert (header[7], rest) == (1, b"")


class TestClock:
    def test_the_offset_of_a_drifting_clock(self) -> None:
        """The error stays below half the quickest round trip beyond its symmetric part, and the drift of a window."""
        random, clock = np.random.default_rng(2), ClockOffset()
        drift, worst = 5e-5, 0.0
        for t in np.arange(0.0, 120.0, 0.01):
            there, back = 0.002 + 0.005 * random.uniform(size=2)
            robot = 1000.0 + (t + there) * (1.0 + drift)
            clock.take(t, robot, robot + 0.003, t + there + 0.003 + back)
            assert abs(clock.offset - (1000.0 + drift * t)) <= clock.round_trip / 2.0 + 6e-4
            worst = max(worst, abs(clock.offset - (1000.0 + drift * t))) if t > 5.0 else 0.0
        assert worst < 1e-3

    def test_ticks_keep_to_the_grid_and_leave_out_what_is_late(self) -> None:
        assert following(1.0, math.nan, 0.01, 1.0) == (1.01, -1)
        for now, k in ((5.0, 1), (5.012, 1), (5.0449, 3), (5.0951, 9)):
            due, found = following(5.0, 5.0, 0.01, now)
            assert (found, due) == (k, pytest.approx(5.0 + 0.01 * k))
        assert following(4.9, 5.0, 0.01, 4.9)[1] == -9


class Recorder(Robot):
    """A robot that notes its commands, and measures what it was told."""

    segments = N

    def __init__(self) -> None:
        self.seen: list[tuple[float, float]] = []
        self.told = np.zeros((N, 2))

    def apply(self, command: Command) -> None:
        self.told = command.contraction
        self.seen.append((time.monotonic(), float(command.contraction[0, 0])))

    def sample(self) -> Mapping[str, tuple[Any, float]]:
        return {"strain": (-self.told, time.monotonic()), "com": (np.array([1.0, 2.0, math.nan]), time.monotonic())}


class Wire:
    """A link in memory, which can be cut."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.peer: Any = None

    def send(self, data: bytes) -> None:
        self.sent.append(data)

    def receive(self, timeout: float) -> Received:
        return []

    def close(self) -> None:
        pass


class TestRobotSide:
    def begun(self) -> RobotSide:
        side = RobotSide(Recorder(), Wire())
        side.tick(0.0)
        assert not side.robot.seen, "moved before the first session"
        side.take(encoded(Packet(Kind.BEGIN, 5, 0, 40.0), N), "here", 1.0)
        return side

    def told(self, side: RobotSide, now: float) -> float:
        side.tick(now)
        return side.robot.seen[-1][1]

    def test_it_rests_when_commands_stop_and_goes_on_when_they_come(self) -> None:
        side = self.begun()
        side.take(encoded(command(1), N), "here", 1.0)
        wanted = float(command(1).values["contraction"][0, 0])
        assert wanted != 0.0
        assert self.told(side, 1.0 + WATCHDOG - 1e-6) == wanted
        assert self.told(side, 1.0 + WATCHDOG + 1e-6) == 0.0
        assert (side.resting, side.rests) == (True, 1)
        side.take(encoded(command(1), N), "here", 2.0)  # a replay
        assert self.told(side, 2.0) == 0.0
        side.take(encoded(command(2), N), "here", 3.0)
        assert self.told(side, 3.0) == float(command(2).values["contraction"][0, 0])
        side.take(encoded(Packet(Kind.REST, 5, 3), N), "here", 3.01)
        assert self.told(side, 3.02) == 0.0
        assert side.rests == 1

    def test_no_second_controller_and_no_old_session(self) -> None:
        side = self.begun()
        side.take(encoded(command(1), N), "here", 1.0)
        side.tick(1.0)
        side.take(encoded(Packet(Kind.BEGIN, 6, 0), N), "there", 1.01)
        assert (side.inbox.session, side.link.peer) == (5, "here")
        side.tick(2.0)
        side.take(encoded(Packet(Kind.BEGIN, 6, 0), N), "there", 2.0)
        assert (side.inbox.session, side.link.peer) == (6, "there")
        side.tick(3.0)
        side.take(encoded(Packet(Kind.BEGIN, 5, 0), N), "here", 3.0)
        side.take(encoded(command(9), N), "here", 3.0)
        assert (side.inbox.session, side.link.peer) == (6, "there")
        assert side.inbox.refused == {Refusal.SESSION: 3}

    def test_samples_of_impossible_instants_are_left_out(self) -> None:
        side = self.begun()
        bad = {"strain": (np.zeros((N, 2)), math.nan), "com": (np.zeros(3), -1.0), "heading": (0.5, math.inf)}
        side.robot.sample = lambda: bad | {"pressure": (np.zeros((N, 2)), 2.0)}
        side.tick(3.0)
        assert [*decoded(side.link.sent[-1], N).values] == ["pressure"]
        assert len(side.link.sent) == 1

    def test_samples_say_when_they_were_taken_and_what_was_heard(self) -> None:
        side = self.begun()
        side.tick(1.02)
        found = decoded(side.link.sent[-1], N)
        assert isinstance(found, Packet)
        assert found.values.keys() == {"strain"}, "a sample that is not finite is left out"
        assert (found.session, found.flags) == (5, RESTING)
        assert (found.echo, found.echo_received) == (pytest.approx(40.0), pytest.approx(1.0))
        assert found.taken <= found.time


class TestControllerSide:
    def side(self) -> ControllerSide:
        return ControllerSide(Board(N, 100), Wire(), 0.01, 0.05, 0.1)

    def answer(self, side: ControllerSide, number: int, now: float, **given: Any) -> None:
        given = {"strain": np.full((N, 2), 0.1 * number)} | given
        there = 500.0 + now  # on the robot's clock
        times = {"echo": now - 0.004, "echo_received": there - 0.003, "taken": there - 0.001}
        packet = Packet(Kind.SAMPLE, side.inbox.session, number, there - 0.001, given, **times)
        side.take(encoded(packet, N), now)

    def kinds(self, side: ControllerSide) -> list[Kind]:
        found = [decoded(data, N) for data in side.link.sent]
        return [each.kind for each in found if isinstance(each, Packet)]

    def test_it_calls_until_the_robot_answers_and_again_when_it_is_silent(self) -> None:
        side = self.side()
        assert [side.tick(-1, t) for t in (1.0, 1.01)] == ["calling"] * 2
        first = side.inbox.session
        self.answer(side, 1, 1.02)
        assert side.tick(-1, 1.03) == "rest"
        assert side.tick(-1, 1.119) == "rest"
        assert side.tick(-1, 1.13) == "calling"
        assert side.inbox.session != first
        assert side.board["sessions"] == 2
        assert self.kinds(side) == [Kind.BEGIN, Kind.BEGIN, Kind.REST, Kind.REST, Kind.BEGIN]

    def test_it_says_nothing_before_the_first_session(self) -> None:
        side = self.side()
        side.send(Kind.REST)
        assert side.link.sent == []

    def test_it_tells_which_row_it_has_sent(self) -> None:
        side = self.side()
        side.tick(-1, 1.0)
        self.answer(side, 1, 1.0)
        side.board["began"] = 1.0
        for k, planned, row in ((1, 1, 0), (2, 2, 1), (3, 4, 3)):
            side.board["planned"] = planned
            assert side.tick(k, 1.0 + 0.01 * k) == ("planned" if row == k else "held")
            assert side.row == row

    def test_there_is_room_for_a_packet_of_each_of_two_sensors(self) -> None:
        """A controller does not become blind without a word: there is room, and the run ends if it is full."""
        bridge = Bridge("udp://127.0.0.1:7", N, 4000)
        board = bridge.board
        board["began"] = board["offset"] = 0.0
        for k in range(2 * 4000):
            board.store(Packet(Kind.SAMPLE, 1, k, taken=0.005 * k), 0.005 * k, 0.0)
        assert board["seen"] == 8000
        board["arrived"] = time.monotonic()
        assert bridge.trouble(10.0) == ""
        board["seen"] = len(board._samples)
        assert bridge.trouble(10.0).startswith("the robot has sent more than 3 packets a tick")

    def test_it_sends_what_was_planned_then_holds_then_rests(self) -> None:
        side = self.side()
        side.tick(-1, 1.0)
        side.board["began"] = 1.0
        side.board.commands[:4] = np.arange(4.0)[:, None] / 10.0
        side.board["planned"] = 4
        found = []
        for k in range(12):
            self.answer(side, k + 1, 1.0 + 0.01 * k)
            found.append(side.tick(k, 1.0 + 0.01 * k))
        assert found == ["planned"] * 4 + ["held"] * 5 + ["rest"] * 3
        sent = [each for each in (decoded(data, N) for data in side.link.sent) if isinstance(each, Packet)]
        assert [each.number for each in sent[1:]] == list(range(1, 13))
        told = [each.values["hinge"][0] for each in sent if each.kind is Kind.COMMAND]
        assert_allclose(told, [0.0, 0.1, 0.2, 0.3, *[0.3] * 5], rtol=1e-6)

    def test_samples_are_stored_at_their_instants_in_the_time_of_the_run(self) -> None:
        side = self.side()
        side.tick(-1, 1.0)
        self.answer(side, 1, 1.5)
        assert side.board["seen"] == 0, "stored before the run"
        side.board["began"] = 2.0
        self.answer(side, 2, 2.5)
        self.answer(side, 3, 2.51, com=np.array([1.0, 2.0, 3.0]))
        assert side.board["offset"] == pytest.approx(500.0)
        assert_allclose(side.board.head("taken"), [0.499, 0.509], atol=1e-9)
        assert_allclose(side.board.head("round_trip"), 0.002, atol=1e-9)
        assert_allclose(side.board.values("strain")[:, 0, 0], [0.2, 0.3], rtol=1e-6)
        assert_array_equal(side.board.values("com"), [[math.nan] * 3, [1.0, 2.0, 3.0]])
        for number in range(4, 3000):
            self.answer(side, number, 3.0)
        assert side.board["seen"] == 1300, "no more room"


def test_a_robot_that_was_switched_off_and_on_is_called_again() -> None:
    ours = ControllerSide(Board(N, 100), Wire(), 0.01, 0.05, 0.1)
    ours.board["began"], ours.board["planned"] = 1.0, 100
    ours.board.commands[:] = 0.25
    theirs, shown = RobotSide(Recorder(), Wire()), []
    for k in range(60):
        now = 1.0 + 0.01 * k
        if k == 20:
            theirs = RobotSide(Recorder(), Wire())  # knows no session, and counts from the beginning
        state = ours.tick(k, now)
        theirs.take(ours.link.sent[-1], "here", now)
        theirs.tick(now)
        for data in theirs.link.sent:
            ours.take(data, now)
        theirs.link.sent.clear()
        shown.append((state, theirs.robot.told[0, 0]))
    assert [state for state, _ in itertools.groupby(state for state, _ in shown)] == ["calling", "planned"] * 2
    assert [told for told, _ in itertools.groupby(told for _, told in shown)] == [0.0, 0.25, 0.0, 0.25]
    assert [k for k, (_, told) in enumerate(shown) if told == 0.0][-1] <= 32, "back within the silence and two ticks"
    assert theirs.inbox.refused[Refusal.SESSION] in (9, 10), "commands of the old session"


class TestLinks:
    @pytest.mark.parametrize(
        "address", ["tcp://a:1", "udp://a", "udp://a:x", "udp://a:70000", "serial:", "serial:a@b", ""]
    )
    def test_a_wrong_address_is_told(self, address: str) -> None:
        with pytest.raises(ValueError, match="must be udp://HOST:PORT"):
            opened(address)

    def test_udp_answers_the_peer_only(self) -> None:
        there = Udp("127.0.0.1", 0, listen=True)
        here = Udp("127.0.0.1", there.port)
        there.send(b"to nobody")
        here.send(b"hello")
        ((data, source),) = there.receive(1.0)
        assert data == b"hello"
        there.peer = source
        there.send(b"answer")
        assert [data for data, _ in here.receive(1.0)] == [b"answer"]
        began = time.monotonic()
        assert here.receive(0.05) == []
        assert time.monotonic() - began >= 0.045
        there.close()
        here.send(b"nobody listens")
        assert here.receive(0.05) == []
        here.close()

    def test_a_serial_line_by_a_pair_of_terminals(self) -> None:
        ours, theirs = os.openpty()
        tty.setraw(ours)
        line = Serial(os.ttyname(theirs))
        sent = [encoded(command(k), N) for k in range(3)]
        os.write(ours, b"noise" + sent[0] + sent[1][:50])
        assert line.receive(1.0) == [(sent[0], None)]
        os.write(ours, sent[1][50:] + sent[2])
        assert line.receive(1.0) == [(sent[1], None), (sent[2], None)]
        line.send(sent[0])
        assert os.read(ours, 4096) == sent[0]
        os.close(theirs)
        os.close(ours)
        began = time.monotonic()
        assert line.receive(0.05) == []
        assert time.monotonic() - began >= 0.045, "the cable is out, and the loop does not spin"
        line.send(sent[0])
        line.close()

    def test_a_serial_rate_that_does_not_exist(self) -> None:
        with pytest.raises(ValueError, match=r"got a rate of 12345 bit/s, must be one of .*115200"):
            opened("serial:/dev/null@12345")

    def test_an_impaired_line_loses_and_delays(self) -> None:
        far = Udp("127.0.0.1", 0, listen=True)
        near = Udp("127.0.0.1", far.port)
        bad = Impaired(far, 0.03, 0.01, 0.3, seed=1)
        began = time.monotonic()
        for k in range(200):
            near.send(bytes([k]))
        found: list[tuple[float, int]] = []
        while time.monotonic() < began + 0.3:
            found += [(time.monotonic() - began, data[0]) for data, _ in bad.receive(0.01)]
        assert 110 < len(found) < 170
        assert min(t for t, _ in found) >= 0.03
        assert [k for _, k in found] != sorted(k for _, k in found), "jitter changes the order"
        assert {k for _, k in found} <= set(range(200))
        near.close()
        bad.close()


@contextmanager
def robot_at() -> Iterator[SimpleNamespace]:
    """A robot in a thread of this process, whose line can be cut."""
    plain = Udp("127.0.0.1", 0, listen=True)
    robot, here = Recorder(), SimpleNamespace(stop=False, cut=False, pulled=0.0, port=plain.port)

    class Cut:
        peer = property(lambda self: plain.peer, lambda self, to: setattr(plain, "peer", to))

        def send(self, data: bytes) -> None:
            if not here.cut:
                plain.send(data)

        def receive(self, timeout: float) -> Received:
            found = plain.receive(timeout)
            return [] if here.cut else found

    def go() -> None:
        here.side = serve(robot, Cut(), goes_on=lambda side: not here.stop)  # type: ignore[arg-type]

    here.robot, here.thread = robot, threading.Thread(target=go)
    here.thread.start()
    try:
        yield here
    finally:
        here.stop = True
        here.thread.join()
        plain.close()


def rest_after(here: SimpleNamespace, since: float) -> float:
    """Return how long after an instant the robot last moved [s]."""
    moved = [t for t, told in here.robot.seen if told != 0.0]
    return max(moved) - since


def growing(t: float, measurement: Any) -> Command:
    return Command(np.full((N, 2), 0.05 + 0.01 * t))


LOADED = 0.05
"""What a busy machine may add to the times of a test [s]."""


@pytest.mark.slow  # in real time: other programs on the machine make controllers late
class TestDrive:
    def test_commands_arrive_in_order_and_samples_come_back(self) -> None:
        found = []

        def step(t: float, measurement: Any) -> Command:
            found.append((t, measurement.strain, measurement.strain_time))
            return growing(t, measurement)

        with robot_at() as here, Bridge(f"udp://127.0.0.1:{here.port}", N, 150) as bridge:
            ending = drive(step, bridge)
        assert (ending.status, ending.ticks) == ("done", 150)
        told = np.array([each for _, each in here.robot.seen if each != 0.0])
        assert len(told) > 75
        assert (np.diff(told) >= 0.0).all()
        planned = 0.05 + 0.01 * 0.01 * np.arange(150)
        assert_allclose(np.abs(told[:, None] - planned).min(axis=1), 0.0, atol=1e-7)
        assert (np.diff(told) > 0.0).mean() > 0.5, "most ticks have a command of their own"
        seen = [(t, strain, at) for t, strain, at in found if strain is not None and strain[0, 0] != 0.0]
        assert len(seen) > 50
        for t, strain, at in seen:
            assert at <= t
            assert -strain[0, 0] <= 0.05 + 0.01 * (at + 0.02) + 1e-7, "a sample is older than its time stamp says"
        assert set(bridge.board.sent[:, 1]) <= {1.0, 2.0, 3.0}

    def test_a_pulled_cable(self) -> None:
        said: list[str] = []
        with robot_at() as here, Bridge(f"udp://127.0.0.1:{here.port}", N, 200) as bridge:

            def goes_on(tick: int) -> bool:
                here.cut = 80 <= tick < 140
                if tick == 80 and not said:
                    here.pulled = here.pulled or time.monotonic()
                return True

            ending = drive(growing, bridge, goes_on=goes_on, say=said.append)
            gap = [t for t, told in here.robot.seen if told != 0.0 and t < here.pulled + 0.3]
            assert max(gap) - here.pulled <= 0.1 + LOADED
        assert ending.status == "done"
        assert [each.partition("robot ")[2] for each in said] == ["is silent", "answers again"]
        assert bridge.board["sessions"] == 2
        assert here.robot.seen[-1][1] == 0.0
        assert rest_after(here, here.pulled) > 0.5, "it went on"
        assert here.side.rests >= 1

    def test_a_robot_that_does_not_come_back_ends_the_run(self) -> None:
        with robot_at() as here, Bridge(f"udp://127.0.0.1:{here.port}", N, 1000) as bridge:

            def goes_on(tick: int) -> bool:
                here.cut = tick >= 20
                return True

            ending = drive(growing, bridge, give_up=0.3, goes_on=goes_on, say=lambda text: None)
        assert ending.status == "diverged"
        assert ending.sentence.startswith("the robot has been silent for 0.3 s; look at")
        assert 20 <= ending.ticks < 200

    def test_the_process_of_the_link_is_killed(self) -> None:
        with robot_at() as here, Bridge(f"udp://127.0.0.1:{here.port}", N, 1000) as bridge:

            def goes_on(tick: int) -> bool:
                if tick == 50:
                    os.kill(bridge.process.pid or 0, signal.SIGKILL)
                    here.killed = time.monotonic()
                    bridge.process.join()
                return True

            ending = drive(growing, bridge, goes_on=goes_on)
            time.sleep(0.2)
            assert rest_after(here, here.killed) <= 0.1 + LOADED
        assert ending.sentence == "the process of the link has ended (exit code -9); the robot rests"

    def test_the_process_of_the_controller_is_killed(self) -> None:
        program = (
            "import numpy as np\nfrom control.bridge.bridge import Bridge, drive\nfrom worm3d import Command\n"
            "if __name__ == '__main__':\n"
            "    with Bridge('udp://127.0.0.1:%d', 3, 3000) as bridge:\n"
            "        drive(lambda t, m: Command(np.full((3, 2), 0.1)), bridge)\n"
        )
        with robot_at() as here:
            one = subprocess.Popen([sys.executable, "-c", program % here.port], cwd=Path(__file__).parents[2])
            until = time.monotonic() + 30.0
            while not any(told for _, told in here.robot.seen) and time.monotonic() < until:
                time.sleep(0.01)
            one.kill()
            killed = time.monotonic()
            one.wait()
            time.sleep(0.4)
            assert rest_after(here, killed - 1.0) > 0.0
            assert rest_after(here, killed) <= 0.1 + LOADED

    def test_no_robot(self) -> None:
        with pytest.raises(NoRobotError, match=r"no robot has answered within 0.4 s; switch it on"):
            Bridge("udp://127.0.0.1:9", N, 10, connecting=0.4).__enter__()
        assert not multiprocessing.active_children()

    def test_an_interrupted_call_leaves_no_process(self, monkeypatch: pytest.MonkeyPatch) -> None:
        bridge = Bridge("udp://127.0.0.1:9", N, 10)

        def sleep(seconds: float) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr("control.bridge.bridge.time.sleep", sleep)
        with pytest.raises(KeyboardInterrupt), bridge:
            pass
        assert not bridge.process.is_alive()

    def test_a_controller_that_is_late_at_the_end_has_run_to_the_end(self) -> None:
        def step(t: float, measurement: Any) -> Command:
            if round(100 * t) == 90:
                time.sleep(0.6)
            return growing(t, measurement)

        with robot_at() as here, Bridge(f"udp://127.0.0.1:{here.port}", N, 100) as bridge:
            assert drive(step, bridge, say=lambda text: None) == ("done", "the robot has run to the end", 100)

    def test_a_controller_that_fails_ends_the_run(self) -> None:
        def step(t: float, measurement: Any) -> Command:
            return growing(t, measurement) if t < 0.3 else Command(np.zeros((N + 1, 2)))

        with robot_at() as here, Bridge(f"udp://127.0.0.1:{here.port}", N, 1000) as bridge:
            ending = drive(step, bridge)
        assert (ending.status, ending.ticks) == ("diverged", 30)
        assert ending.sentence.startswith("the controller failed: ValueError: ")
        assert here.robot.seen[-1][1] == 0.0

    def test_stopped_by_the_user(self) -> None:
        with robot_at() as here, Bridge(f"udp://127.0.0.1:{here.port}", N, 1000) as bridge:
            ending = drive(growing, bridge, goes_on=lambda tick: tick < 30)
        assert ending == ("interrupted", "stopped at 0.3 s", 30)

    def test_a_late_controller_is_held_then_rested(self) -> None:
        def step(t: float, measurement: Any) -> Command:
            if round(100 * t) == 60:
                time.sleep(0.7)
            return growing(t, measurement)

        with robot_at() as here, Bridge(f"udp://127.0.0.1:{here.port}", N, 160) as bridge:
            assert drive(step, bridge, say=lambda text: None).status == "done"
        sent = [STATES[int(each)] for each in bridge.board.sent[:, 1]]
        runs = [state for state, _ in itertools.groupby(sent[55:]) if state != "not sent"]
        assert runs[:3] == ["planned", "held", "rest"]
        assert "planned" in runs[3:], "it catches up"
        assert sent[55:].count("held") >= 15

    def test_a_controller_that_is_late_at_the_end(self) -> None:
        def step(t: float, measurement: Any) -> Command:
            if round(100 * t) == 50:
                time.sleep(1.0)
            return growing(t, measurement)

        said: list[str] = []
        with robot_at() as here, Bridge(f"udp://127.0.0.1:{here.port}", N, 60) as bridge:
            ending = drive(step, bridge, say=said.append)
        assert (ending, said) == (("done", "the robot has run to the end", 60), [])


@pytest.fixture
def firmware(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The firmware with a clock that the test turns, in microseconds; it runs over after 2**30, as on the board."""
    now = [0]
    spec = importlib.util.spec_from_file_location("firmware_worm", FIRMWARE)
    assert spec is not None
    assert spec.loader is not None
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    half = 2**29
    board = SimpleNamespace(
        ticks_us=lambda: now[0] % 2**30, ticks_diff=lambda a, b: (a - b + half) % 2**30 - half, turn=now
    )
    monkeypatch.setattr(found, "time", board)
    return found


class TestFirmware:
    SIX = 6

    def command(self, number: int, session: int = 8) -> bytes:
        given = values(np.random.default_rng(number), *COMMANDED, segments=self.SIX)
        return encoded(Packet(Kind.COMMAND, session, number, 2.0, given), self.SIX)

    def test_it_has_the_same_protocol(self, firmware: ModuleType) -> None:
        assert struct.calcsize(firmware.HEADER) == firmware.SIZE == packets.HEADER.size
        assert tuple(PARTS) == firmware.NAMES
        assert tuple(int(np.prod(shape(name, firmware.N))) for name in PARTS) == firmware.COUNTS
        assert [*Kind] == [firmware.BEGIN, firmware.COMMAND, firmware.REST, firmware.SAMPLE]
        assert firmware.WATCHDOG_US == WATCHDOG * 1e6

    def test_it_takes_our_packets_and_we_take_its(self, firmware: ModuleType) -> None:
        data = b"noise" + encoded(Packet(Kind.BEGIN, 8, 0), self.SIX) + self.command(1)
        side = firmware.Side()
        for now in (1000, 2000):
            header, given, data = firmware.next_packet(data)
            side.take(header, given, now)
        assert data == b""
        wanted = values(np.random.default_rng(1), *COMMANDED, segments=self.SIX)
        contraction, hinge = side.wanted(2500)
        assert_array_equal(contraction, wanted["contraction"].ravel())
        assert_array_equal(hinge, wanted["hinge"])
        found = decoded(side.sample({"strain": [0.5] * 12, "pressure": [1e5] * 12}, 2600, 2700), self.SIX)
        assert isinstance(found, Packet)
        assert (found.session, found.number, found.flags) == (8, 1, 0)
        assert (found.echo, found.echo_received, found.taken, found.time) == pytest.approx((2.0, 2e-3, 2.6e-3, 2.7e-3))
        assert_array_equal(found.values["pressure"], np.full((6, 2), 1e5))

    def test_it_refuses_what_our_robots_refuse(self, firmware: ModuleType) -> None:
        random, good = np.random.default_rng(5), self.command(1)
        for k in range(3000):
            bad = bytearray(good)
            bad[int(random.integers(len(bad)))] ^= int(random.integers(1, 256))
            cut = bytes(bad) if k % 2 else good[: int(random.integers(len(good)))]
            assert firmware.next_packet(cut)[0] is None
        side, first = firmware.Side(), encoded(Packet(Kind.BEGIN, 8, 0), self.SIX)

        def take(data: bytes, now: int) -> None:
            side.take(*firmware.next_packet(data)[:2], now)

        take(self.command(1), 0)  # no session yet
        take(first, 0)
        take(self.command(2), 0)
        assert side.wanted(80_000) is not None
        for data in (
            self.command(2),
            self.command(1),
            self.command(3, session=9),
            encoded(Packet(Kind.BEGIN, 9, 0), 6),
        ):
            take(data, 70_000)
        assert side.refused == 5
        assert side.wanted(80_001) is None, "refused packets do not feed the watchdog"
        take(first, 90_000)  # replayed
        assert (side.session, side.refused) == (8, 6)
        take(encoded(Packet(Kind.BEGIN, 9, 0), self.SIX), 90_000)
        assert side.session == 9

    def test_its_loop_drives_the_hardware(self, firmware: ModuleType) -> None:
        told, line = [], SimpleNamespace(out=[], given=[encoded(Packet(Kind.BEGIN, 8, 0), 6), self.command(1)[:50]])
        line.given.append(self.command(1)[50:])

        def read() -> bytes | None:
            firmware.time.turn[0] += 3000
            return line.given.pop(0) if line.given else None

        line.read, line.write = read, line.out.append
        hardware = SimpleNamespace(
            line=line, sample=lambda: {"strain": [0.0] * 12}, apply=lambda *each: told.append(each)
        )
        firmware.time.turn[0] = 2**30 - 20_000  # the counter soon runs over
        side, clock = firmware.Side(), firmware.Clock()
        data, due = b"", 10_000
        for _ in range(12):
            data, due = firmware.loop(hardware, side, clock, data, due)
        moved = [any(contraction) for contraction, _ in told]
        assert moved[:2] == [True, True]
        assert moved[-1] is False, "the watchdog"
        assert 8 <= sum(moved) <= 10
        assert len(line.out) == 12
        assert clock.now() == pytest.approx(120_000, abs=6000)

    @pytest.mark.slow  # in real time, as above
    def test_a_controller_drives_it_over_a_serial_line(self, firmware: ModuleType) -> None:
        ours, theirs = os.openpty()
        tty.setraw(ours)
        os.set_blocking(ours, False)
        told: list[float] = []
        stop = threading.Event()

        def read() -> bytes | None:
            time.sleep(5e-4)
            with suppress(BlockingIOError):
                return os.read(ours, 4096)
            return None

        line = SimpleNamespace(read=read, write=lambda data: os.write(ours, data))
        hardware = SimpleNamespace(
            line=line,
            apply=lambda contraction, hinge: told.append(contraction[0]),
            sample=lambda: {"strain": [-told[-1]] * 12},
        )
        firmware.time.ticks_us = lambda: int(time.monotonic() * 1e6) % 2**30
        side, clock = firmware.Side(), firmware.Clock()

        def serve_it() -> None:
            data, due = b"", clock.now()
            while not stop.is_set():
                data, due = firmware.loop(hardware, side, clock, data, due)

        board = threading.Thread(target=serve_it)
        board.start()
        seen: list[Any] = []

        def step(t: float, measurement: Any) -> Command:
            seen.append(measurement.strain)
            return Command(np.full((self.SIX, 2), 0.05 + 0.1 * t))

        try:
            with Bridge(f"serial:{os.ttyname(theirs)}", self.SIX, 120) as bridge:
                ending = drive(step, bridge)
        finally:
            stop.set()
            board.join()
            os.close(ours)
            os.close(theirs)
        assert ending.status == "done"
        moved = [each for each in told if each != 0.0]
        assert len(moved) > 60
        assert (np.diff(moved) >= 0.0).all()
        assert told[-1] == 0.0
        strains = [each[0, 0] for each in seen if each is not None]
        assert -0.17 < min(strains) < -0.1
        assert side.refused == 0
