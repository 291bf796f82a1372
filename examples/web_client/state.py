#!/usr/bin/env python3
"""Prints the tip of every live tool, from bregma-gateway. Python's standard library only.

    state.py [HOST[:PORT]] [SECONDS]          default: localhost:8310, without an end

docs/gateway.md describes the messages. This client reads /state?format=json, in which an unknown number is null.
"""
import base64
import hashlib
import json
import os
import socket
import struct
import sys
import time

LIVE = 1  # PoseStatus in idl/state.idl; POSE_UNVERIFIED (2) is for check touches only


class WebSocket:
    """As much of RFC 6455 as this needs: text messages of a server that does not compress."""

    def __init__(self, host, port, path):
        self.socket = socket.create_connection((host, port), timeout=5.0)
        self.buffer = b""
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(
            (
                f"GET {path} HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n"
            ).encode()
        )
        while b"\r\n\r\n" not in self.buffer:
            self.receive()
        answer, self.buffer = self.buffer.split(b"\r\n\r\n", 1)
        expected = base64.b64encode(hashlib.sha1((key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11").encode()).digest())
        if not answer.startswith(b"HTTP/1.1 101") or expected not in answer:
            raise ConnectionError(answer.split(b"\r\n", 1)[0].decode(errors="replace"))

    def receive(self):
        part = self.socket.recv(65536)
        if not part:
            raise ConnectionError("the gateway has closed the connection")
        self.buffer += part

    def take(self, size):
        while len(self.buffer) < size:
            self.receive()
        out, self.buffer = self.buffer[:size], self.buffer[size:]
        return out

    def send(self, text, opcode=1):
        payload, mask = text.encode() if isinstance(text, str) else text, os.urandom(4)
        masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(payload))
        self.socket.sendall(bytes([0x80 | opcode, 0x80 | len(payload)]) + mask + masked)  # at most 125 bytes

    def read(self):
        message = b""
        while True:
            first, second = self.take(2)
            size = second & 0x7F
            if size == 126:
                (size,) = struct.unpack(">H", self.take(2))
            elif size == 127:
                (size,) = struct.unpack(">Q", self.take(8))
            payload = self.take(size)
            opcode = first & 0x0F
            if opcode == 8:
                raise ConnectionError("the gateway has closed the socket")
            if opcode == 9:  # a ping
                self.send(payload, opcode=10)
            elif opcode in (0, 1):
                message += payload
                if first & 0x80:
                    return message.decode()


def main():
    address = sys.argv[1] if len(sys.argv) > 1 else "localhost:8310"
    host, _, port = address.partition(":")
    end = time.monotonic() + float(sys.argv[2]) if len(sys.argv) > 2 else float("inf")
    state = WebSocket(host, int(port or 8310), "/state?format=json")
    state.send(json.dumps({"rate": 10}))
    while time.monotonic() < end:
        frame = json.loads(state.read())
        for record in frame["records"]:
            if record["kind"] != "tool" or record.get("ended") or record["status"] != LIVE:
                continue
            age_ms = frame["written_ms"] - record["acquired_ms"]
            tip = " ".join(f"{x:8.2f}" for x in record["tip_mm"])
            print(f"{record['tool']:16} {tip} mm   95 % within {record['tre_95_semi_axes_mm'][0]:.2f} mm   {age_ms:.0f} ms old")
        state.send(json.dumps({"ack": frame["frame"]}))  # the next one is sent after this


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        pass
    except (OSError, ValueError) as error:
        sys.exit(f"state.py: {error}")
