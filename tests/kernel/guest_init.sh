#!/bin/busybox sh
# The guest's first process. Owns: modules, mounts, one command, the end of the machine.
# Must not know what is run: that is in the shared folder, as `command`.
#
# The guest's root is the host's, read-only, under a layer in memory: the guest sees the working
# tree and its virtual environment as they are, and what it writes is gone with it.
/bin/busybox mkdir -p /proc /sys /dev /host /layer /new /run
/bin/busybox mount -t proc proc /proc
/bin/busybox mount -t sysfs sysfs /sys
/bin/busybox mount -t devtmpfs devtmpfs /dev
exec >/dev/ttyS0 2>&1

# Without a status, the run shows this console and fails.
fail() {
    echo "rig: $1"
    /bin/busybox poweroff -f
}

# rig.layers=A:B: folders of the share "layers" that lie over the root. rig.first=PROGRAM: what goes
# on as the first process, and runs the command, and ends the machine.
layers= first=
for word in $(/bin/busybox cat /proc/cmdline); do
    case "$word" in
    rig.layers=*) layers="${word#rig.layers=}" ;;
    rig.first=*) first="${word#rig.first=}" ;;
    esac
done

for module in $(/bin/busybox cat /modules/order); do
    /bin/busybox insmod "/modules/$module" || fail "the module $module does not load"
done

share="trans=virtio,version=9p2000.L,msize=262144"
/bin/busybox mount -t 9p -o "ro,cache=loose,$share" hostroot /host || fail "no root folder"
if [ -n "$layers" ]; then
    # A share of their own: a layer may not lie within another.
    /bin/busybox mkdir -p /layers
    /bin/busybox mount -t 9p -o "ro,cache=loose,$share" layers /layers || fail "no layers"
    layers="/layers/$(echo "$layers" | /bin/busybox sed 's|:|:/layers/|g'):"
fi
/bin/busybox mount -t tmpfs -o size=60% tmpfs /layer
/bin/busybox mkdir -p /layer/upper /layer/work /layer/out
/bin/busybox mount -t 9p -o "cache=none,$share" out /layer/out || fail "no shared folder"
/bin/busybox mount -t overlay -o "lowerdir=$layers/host,upperdir=/layer/upper,workdir=/layer/work" \
    overlay /new || fail "no layer over the root folder"
# This machine may be a container; the guest is none, and systemd would leave udev out.
/bin/busybox rm -f /new/.dockerenv

for folder in proc sys dev; do
    /bin/busybox mount --move "/$folder" "/new/$folder"
done
/bin/busybox mkdir -p /new/dev/shm /new/dev/pts
/bin/busybox mount -t tmpfs tmpfs /new/dev/shm
/bin/busybox mount -t devpts devpts /new/dev/pts
/bin/busybox mount -t tmpfs tmpfs /new/run
/bin/busybox mount -t tracefs tracefs /new/sys/kernel/tracing
/bin/busybox mkdir -p /new/run/rig
/bin/busybox mount --move /layer/out /new/run/rig || fail "the shared folder does not move"
/bin/busybox ip link set lo up

if [ -n "$first" ]; then
    # What is left here is of no more use, and goes.
    exec /bin/busybox switch_root /new "$first"
fi

/bin/busybox stty -F /new/dev/ttyS1 raw 2>/dev/null
/bin/busybox chroot /new /bin/sh /run/rig/command </dev/null >/new/dev/ttyS1 2>&1
echo $? >/new/run/rig/status
/bin/busybox sync
/bin/busybox poweroff -f
