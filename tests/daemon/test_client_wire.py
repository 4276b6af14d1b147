"""How a client's sockets of ZeroMQ are set.

Owns: the options whose effect would take a daemon that is not there, or a crowd, to see.
"""

from __future__ import annotations

import zmq

from etd.client.wire import configure


def test_where_the_line_of_newcomers_is_full_it_is_soon_tried_again() -> None:
    """What is sent first may be a stop; by itself libzmq waits for 100 ms."""
    with zmq.Context() as context, context.socket(zmq.DEALER) as made:
        configure(made, "ipc:///nowhere/control.sock")
        assert made.getsockopt(zmq.RECONNECT_IVL) == 10
        assert made.getsockopt(zmq.RECONNECT_IVL_MAX) == 100
