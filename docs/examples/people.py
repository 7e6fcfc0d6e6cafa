#!/usr/bin/env python3
"""Who moves in the hidden room, live: python3 people.py [URL [UPDATES]]

Needs nothing but Python's standard library, and therefore speaks WebSocket (RFC 6455) itself.
"""

import base64
import json
import os
import socket
import struct
import sys
import urllib.parse
import urllib.request

CONTINUATION, TEXT, CLOSE, PING, PONG = 0x0, 0x1, 0x8, 0x9, 0xA


class Live:
    """The messages of doorcam's live socket, one after another."""

    def __init__(self, url, timeout_s=30):
        where = urllib.parse.urlsplit(url)
        self.socket = socket.create_connection((where.hostname, where.port or 80), timeout_s)
        key = base64.b64encode(os.urandom(16)).decode()
        request = (
            "GET /api/v1/live HTTP/1.1\r\n"
            f"Host: {where.netloc}\r\n"
            "Connection: Upgrade\r\nUpgrade: websocket\r\n"
            f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n\r\n"
        )
        self.socket.sendall(request.encode())
        self.stream = self.socket.makefile("rb")
        status = self.stream.readline().decode().strip()
        while self.stream.readline().strip():
            pass
        if " 101 " not in f"{status} ":
            raise ConnectionError(f"no live socket: {status}")

    def __iter__(self):
        message = b""
        while True:
            last, kind, data = self.frame()
            if kind == CLOSE:
                return
            if kind == PING:
                self.answer(PONG, data)
            elif kind in (TEXT, CONTINUATION):
                message += data
                if last:
                    yield json.loads(message)
                    message = b""

    def frame(self):
        first, length = self.read(2)
        if length == 126:
            (length,) = struct.unpack("!H", self.read(2))
        elif length == 127:
            (length,) = struct.unpack("!Q", self.read(8))
        return bool(first & 0x80), first & 0x0F, self.read(length)

    def read(self, count):
        data = self.stream.read(count)
        if len(data) < count:
            raise ConnectionError("doorcam is gone")
        return data

    def answer(self, kind, data):
        # What a client sends is masked; at most 125 bytes, as every control frame.
        mask = os.urandom(4)
        masked = bytes(byte ^ mask[k % 4] for k, byte in enumerate(data))
        self.socket.sendall(bytes([0x80 | kind, 0x80 | len(data)]) + mask + masked)


def main(url="http://127.0.0.1:8080", updates=None):
    with urllib.request.urlopen(f"{url}/api/v1/status", timeout=30) as answer:
        status = json.load(answer)
    print(f"doorcam {status['version']} watches {status['source']['spec']}: {status['state']}")
    for count, update in enumerate(Live(url), start=1):
        missed = f" (missed {update['missed']})" if "missed" in update else ""
        print(f"update {update['sequence']}: {update['state']}, {len(update['tracks'])} followed{missed}")
        for track in update["tracks"]:
            print(f"  {track['id']}: {track['state']} at x {track['x_m']:.2f} m, y {track['y_m']:.2f} m")
        if updates is not None and count == int(updates):
            return


if __name__ == "__main__":
    main(*sys.argv[1:])
