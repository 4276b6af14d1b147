"""A target in seconds, without a fuzzer: seeds, what was found once, and inputs near them.

Owns: the inputs, drawn by hypothesis so that a failure comes out small. Must not know: targets.
"""

from __future__ import annotations

from functools import cache

from hypothesis import strategies as st

from fuzz.mutation import words
from fuzz.target import Target


@cache
def _strategy(target: Target) -> st.SearchStrategy[bytes]:
    seeds = list(target.seeds())
    vocabulary = words(seeds)

    @st.composite
    def near(draw: st.DrawFn) -> bytes:
        data = bytearray(draw(st.sampled_from(seeds)))
        for _ in range(draw(st.integers(1, 3))):
            at = draw(st.integers(0, len(data)))
            end = at + draw(st.sampled_from((0, 1, 2, 8, 64)))
            data[at:end] = draw(
                st.one_of(
                    st.sampled_from(vocabulary), st.binary(max_size=4), st.just(data[at:end] * 3)
                )
            )
        return bytes(data)

    return st.one_of(near(), near(), st.binary(max_size=200))


def inputs(target: Target) -> st.SearchStrategy[bytes]:
    """Half of all, and more, are one to three changes from a seed."""
    return _strategy(target)
