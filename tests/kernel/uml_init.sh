#!/bin/busybox sh
# The first process of the virtual-time guest. Owns: the module, mounts, one command, the end.
# Must not know what is run: that is in the shared folder, as `command`.
#
# The guest's root is the host's; everything below runs under a layer in memory, and what it
# writes is gone with it.
# rig.layers=A:B: folders of rig.pieces that lie over the root. rig.first=PROGRAM: what goes on as
# the first process, and runs the command, and ends the machine.
busybox=/bin/busybox
$busybox mount -t proc proc /proc
layers= first=
for word in $($busybox cat /proc/cmdline); do
    case "$word" in
    rig.out=*) out="${word#rig.out=}" ;;
    rig.module=*) module="${word#rig.module=}" ;;
    rig.pieces=*) pieces="${word#rig.pieces=}" ;;
    rig.layers=*) layers="${word#rig.layers=}" ;;
    rig.first=*) first="${word#rig.first=}" ;;
    esac
done

# Without a status, the run shows this console and fails.
fail() {
    echo "rig: $1"
    $busybox poweroff -f
}

$busybox mount -t sysfs sysfs /sys
$busybox mount -t devtmpfs devtmpfs /dev
$busybox mount -t tmpfs tmpfs /srv
$busybox mkdir -p /srv/upper /srv/work /srv/new /srv/layers
$busybox insmod "$module" || fail "the module does not load"
if [ -n "$layers" ]; then
    # Mounted apart: a layer may not lie within another.
    $busybox mount -t hostfs -o "$pieces" none /srv/layers || fail "no layers"
    layers="/srv/layers/$(echo "$layers" | $busybox sed 's|:|:/srv/layers/|g'):"
fi
$busybox mount -t overlay -o "lowerdir=$layers/,upperdir=/srv/upper,workdir=/srv/work" \
    overlay /srv/new || fail "no layer over the root folder"
# This machine may be a container; the guest is none, and systemd would leave udev out.
$busybox rm -f /srv/new/.dockerenv
$busybox mount -t proc proc /srv/new/proc
$busybox mount -t sysfs sysfs /srv/new/sys
$busybox mount -t devtmpfs devtmpfs /srv/new/dev
$busybox mkdir -p /srv/new/dev/shm /srv/new/dev/pts
$busybox mount -t tmpfs tmpfs /srv/new/dev/shm
$busybox mount -t devpts devpts /srv/new/dev/pts
$busybox mount -t tmpfs tmpfs /srv/new/run
$busybox mount -t tracefs tracefs /srv/new/sys/kernel/tracing
$busybox mkdir -p /srv/new/run/rig
$busybox mount -t hostfs -o "$out" none /srv/new/run/rig || fail "no shared folder"
$busybox ip link set lo up
# High-resolution timers begin at a tick of the clock, and without waiting none comes.
$busybox usleep 50000

if [ -n "$first" ]; then
    # The root of the whole machine, not of this process alone: a service that has users of its own
    # could not be started in the latter.
    cd /srv/new && $busybox pivot_root . mnt || fail "the root does not change"
    cd /
    $busybox umount -l /mnt
    exec "$first"
fi

$busybox chroot /srv/new /bin/sh /run/rig/command </dev/null >/srv/new/run/rig/output 2>&1
echo $? >/srv/new/run/rig/status
$busybox sync
$busybox poweroff -f
