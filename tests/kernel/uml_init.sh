#!/bin/busybox sh
# The first process of the virtual-time guest. Owns: the module, mounts, one command, the end.
# Must not know what is run: that is in the shared folder, as `command`.
#
# The guest's root is the host's; everything below runs under a layer in memory, and what it
# writes is gone with it. The kernel hands `rig.out` and `rig.module` on as variables.
busybox=/bin/busybox
$busybox mount -t proc proc /proc
for word in $($busybox cat /proc/cmdline); do
    case "$word" in
    rig.out=*) out="${word#rig.out=}" ;;
    rig.module=*) module="${word#rig.module=}" ;;
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
$busybox mkdir -p /srv/upper /srv/work /srv/new
$busybox insmod "$module" || fail "the module does not load"
$busybox mount -t overlay -o "lowerdir=/,upperdir=/srv/upper,workdir=/srv/work" \
    overlay /srv/new || fail "no layer over the root folder"
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

$busybox chroot /srv/new /bin/sh /run/rig/command </dev/null >/srv/new/run/rig/output 2>&1
echo $? >/srv/new/run/rig/status
$busybox sync
$busybox poweroff -f
