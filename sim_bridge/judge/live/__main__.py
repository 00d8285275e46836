"""The process of a map: `python -m sim_bridge.judge.live LISTENER END`, two open sockets by their numbers."""

from __future__ import annotations

import signal
import socket
import sys

from sim_bridge.judge.live.server import serve_map

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the flight ends it, by closing its end
    listener, end = (socket.socket(fileno=int(number)) for number in sys.argv[1:3])
    end.setblocking(False)
    serve_map(listener, end)
