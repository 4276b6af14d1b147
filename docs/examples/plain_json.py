"""A client in plain JSON, with nothing but pyzmq: Python 3.8 and later, or as a model for others.

python plain_json.py ipc:///run/etd/main/control.sock
"""

import json
import sys
import time

import zmq

control = zmq.Context.instance().socket(zmq.REQ)
control.RCVTIMEO = 5000
control.LINGER = 0
control.connect(sys.argv[1] if len(sys.argv) > 1 else "ipc:///run/etd/main/control.sock")


def ask(**request):
    control.send_string(json.dumps(request))
    try:
        reply = json.loads(control.recv())
    except zmq.Again:
        said = "no daemon answers there: give its address, which `etd run` prints"
        raise SystemExit(said) from None
    if not reply["ok"]:
        raise SystemExit("{error}: {reason}".format(**reply))
    return reply


electrodes = ask(op="hello")["array"]["electrodes"]
limits = {"max_current_ua": 1500, "width_us": 100}
lease = ask(op="open", client="plain json", limits=limits)["lease"]
ask(op="arm")
current_ua = [0] * electrodes
current_ua[electrodes // 2] = 1500
for seq in range(1, 21):
    frame = ask(op="frame", lease=lease, seq=seq, current_ua=current_ua, account=True)
    for clamp in frame["clamped"]:
        print("clamped to", clamp["allowed_ua"], "uA by", clamp["reason"])
    time.sleep(0.05)
account = ask(op="account", lease=lease, seq=seq)["account"]
print(sum(account["pulses"]), "pulses of up to", max(account["most_ua"]), "uA in the last frame")
ask(op="close", lease=lease)
