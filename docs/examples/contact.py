"""Which electrodes touch the skin, as it changes, while something is shown."""

from collections import Counter

from etd import Display

with Display() as display, display.telemetry("scan", timeout_s=5) as reports:
    print("touched before:", display.measure().contact.count(True), "of", display.electrodes)
    display.arm(open_to=0.4)
    display.show([0.4] * display.electrodes, ttl_ms=1_000, allow_slower=True)
    for _, scan in reports:
        kinds = scan.fired.contact
        if all(kinds):
            worst = max(ohm for ohm in scan.fired.resistance_ohm if ohm is not None)
            counts = ", ".join(f"{count} {kind}" for kind, count in Counter(kinds).items())
            print(f"{counts}; up to {worst} ohm")
            break
