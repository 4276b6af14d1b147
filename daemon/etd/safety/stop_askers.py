"""Whose stop stands: a user's stop is lifted by that user, or by an operator.

Owns: the users that asked for a stop since the last halt was cleared, and who may clear it. Must
not know: states, sockets, who is an operator.

Without it a stop would last as long as no program clears it: any member of the group that reaches
the socket could answer each stop of another one with `clear` and `arm`. See docs/decisions/0091.
"""

from __future__ import annotations

from etd.protocol.errors import Refused


class StopAskers:
    def __init__(self) -> None:
        self._uids: set[int] = set()

    def asked(self, uid: int | None) -> None:
        """Also where the board was halted already: who asks second did not see that it was. `uid`
        None: in nobody's name, so that it binds nobody.
        """
        if uid is not None and len(self._uids) < 2:
            # Two are enough: from then on none of them may lift it alone.
            self._uids.add(uid)

    def check(self, uid: int | None, *, is_operator: bool) -> None:
        """Raises: Refused (`not_permitted`), unless no other user's stop stands."""
        if is_operator or self._uids <= {uid}:
            return
        others = sorted(self._uids - {uid})
        who = f"user {others[0]}" if len(others) == 1 else f"users {others[0]} and others"
        raise Refused(
            "not_permitted",
            f"{who} asked for a stop, which is for that user to lift, for root, or for an operator"
            " that the configuration names: ask one of these for `etd clear`",
        )

    def lifted(self) -> None:
        """The halt was cleared."""
        self._uids.clear()
