"""Robot side of the bridge for a microcontroller with MicroPython 1.20 or newer, here a Raspberry Pi Pico.

Change `N` and the class `Hardware` for your robot, and copy this file to the board as main.py. The protocol is
described in `control/bridge/packets.py`; every robot has the watchdog and the sessions of `Side`.
"""

import struct
import time
from binascii import crc32

N = 6  # segments
BAUD, PERIOD_US, WATCHDOG_US = 1000000, 10000, 80000
HEADER, SIZE, LARGEST = "<4sBBHHHIIQQQQ", 52, 4096
BEGIN, COMMAND, REST, SAMPLE = 1, 2, 3, 4
NAMES = ("contraction", "hinge", "strain", "com", "heading", "angular_rate", "contact_load", "pressure")
COUNTS = (2 * N, N - 1, 2 * N, 3, 1, 3 * N, 6 * N, 2 * N)
COMMAND_PARTS = 3  # bits of contraction and hinge


def count_of(mask):
    """Return the number of values of the parts in a mask."""
    return sum(count for bit, count in enumerate(COUNTS) if mask >> bit & 1)


def next_packet(data):
    """Return the header and the values of the first packet in some bytes, and the bytes after it.

    The header is None if there is no whole packet. Damaged packets, and packets of other robots, are dropped. A header
    with a damaged length does not hold back the packets after it.
    """
    kept, begin = max(0, len(data) - 3), data.find(b"WORM")
    while begin >= 0:
        end, valid = begin + SIZE, True
        if len(data) >= end:
            header = struct.unpack_from(HEADER, data, begin)
            count = count_of(header[5])
            end += 4 * count + 4
            valid = header[1] == 1 and header[4] == N and not header[5] >> len(COUNTS)
            if valid and len(data) >= end:
                values = struct.unpack_from("<%df" % count, data, begin + SIZE)  # noqa: UP031 - as short on old boards
                finite = all(-1e30 < each < 1e30 for each in values)
                if finite and crc32(data[begin : end - 4]) == struct.unpack_from("<I", data, end - 4)[0]:
                    return header, values, data[end:]
        if valid and len(data) < end:
            kept = min(kept, begin)
        begin = data.find(b"WORM", begin + 1)
    return None, (), data[kept:]


class Side:
    """Session, watchdog and packets of the robot. Times are in microseconds."""

    def __init__(self):
        self.session, self.number, self.sent = None, -1, 0
        self.used, self.refused = set(), 0
        self.command, self.resting = None, True
        self.heard, self.echo = -WATCHDOG_US - 1, 0

    def take(self, header, values, now):
        """Take a packet that arrived now."""
        kind, mask, session, number = header[2], header[5], header[6], header[7]
        if kind == BEGIN:
            repeated = session == self.session and self.number < 0
            valid = repeated or (self.resting and session not in self.used)
            if valid and not repeated:
                self.used.add(session)
                self.session, self.number, self.sent = session, -1, 0
        else:
            valid = session == self.session and number > self.number
            valid = valid and (kind == REST or (kind == COMMAND and mask & COMMAND_PARTS == COMMAND_PARTS))
            if valid:
                self.number = number
        if not valid:
            self.refused += 1
            return
        self.heard, self.echo = now, header[8]
        self.command = values if kind == COMMAND else None

    def wanted(self, now):
        """Return the contractions [left, right of each segment] and hinge angles; None for rest."""
        late = now - self.heard > WATCHDOG_US
        self.resting = late or self.command is None
        return None if self.resting else (self.command[: 2 * N], self.command[2 * N : 3 * N - 1])

    def sample(self, samples, taken, now):
        """Return the packet with some samples, by name, that were taken at an instant."""
        mask, values = 0, []
        for bit, name in enumerate(NAMES):
            if name in samples:
                mask |= 1 << bit
                values += samples[name]
        self.sent += 1
        times = now, self.echo, self.heard, taken
        head = struct.pack(HEADER, b"WORM", 1, SAMPLE, self.resting, N, mask, self.session, self.sent, *times)
        body = head + struct.pack("<%df" % len(values), *values)  # noqa: UP031
        return body + struct.pack("<I", crc32(body))


class Clock:
    """Microseconds since the start. The counter of the board runs over after some minutes, this one does not."""

    def __init__(self):
        self.last, self.total = time.ticks_us(), 0

    def now(self):
        """Return the microseconds since the start. Must be called every few minutes."""
        ticks = time.ticks_us()
        self.total += time.ticks_diff(ticks, self.last)
        self.last = ticks
        return self.total


class Hardware:
    """A servo for each chamber at the pins 0 to 2 N - 1, and strain gauges behind a multiplexer."""

    REST_NS, STROKE_NS = 1000000, 2000000  # pulse at rest, and its change per contraction
    ADC_REST, ADC_PER_STRAIN = 32768, 60000  # reading at rest, and its change per strain

    def __init__(self):
        from machine import ADC, PWM, UART, Pin

        self.line = UART(0, BAUD, tx=Pin(12), rx=Pin(13), rxbuf=LARGEST)
        self.servos = [PWM(Pin(pin), freq=50) for pin in range(2 * N)]
        self.select = [Pin(pin, Pin.OUT) for pin in range(14, 18)]
        self.gauge = ADC(Pin(26))

    def apply(self, contraction, hinge):
        """Set the servos."""
        for servo, each in zip(self.servos, contraction):  # noqa: B905 - not in MicroPython
            servo.duty_ns(int(self.REST_NS + self.STROKE_NS * min(max(each, 0.0), 0.4)))

    def sample(self):
        """Return the samples by name, as lists in the order of the protocol."""
        strain = []
        for chamber in range(2 * N):
            for bit, pin in enumerate(self.select):
                pin.value(chamber >> bit & 1)
            strain.append((self.gauge.read_u16() - self.ADC_REST) / self.ADC_PER_STRAIN)
        return {"strain": strain}


def loop(hardware, side, clock, data, due):
    """Run one period; return the bytes that are left on the line, and when the next period is due."""
    while clock.now() < due:
        data += hardware.line.read() or b""
        header, values, data = next_packet(data)
        if header:
            side.take(header, values, clock.now())
    now = clock.now()
    wanted = side.wanted(now)
    hardware.apply(*(wanted or ((0.0,) * (2 * N), (0.0,) * (N - 1))))
    if side.session is not None:
        hardware.line.write(side.sample(hardware.sample(), now, clock.now()))
    return data[-LARGEST:], max(due + PERIOD_US, now)


def main():
    """Serve forever."""
    hardware, side, clock = Hardware(), Side(), Clock()
    data, due = b"", clock.now()
    while True:
        data, due = loop(hardware, side, clock, data, due)


if __name__ == "__main__":
    main()
