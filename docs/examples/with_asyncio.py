"""The same calls, awaited: a stimulus while something else goes on."""

import asyncio

from etd import AsyncDisplay


async def count(ticks: list[int]) -> None:
    while True:
        await asyncio.sleep(0.05)
        ticks.append(1)


async def main() -> None:
    async with AsyncDisplay() as display, display.kept():
        await display.arm(open_to=0.6)
        ticks: list[int] = []
        counting = asyncio.create_task(count(ticks))
        underway = display.begin({27: 0.6}, seconds=1.0)
        print((await display.status()).state, "while it is felt")
        shown = await underway
        counting.cancel()
        print(f"{max(shown.pulses)} pulses, {len(ticks)} ticks meanwhile")


asyncio.run(main())
