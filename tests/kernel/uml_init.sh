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
$busybox mount -t tmpfs tmpfs /mnt
$busybox mkdir -p /mnt/upper /mnt/work /mnt/new
$busybox insmod "$module" || fail "the module does not load"
$busybox mount -t overlay -o "lowerdir=/,upperdir=/mnt/upper,workdir=/mnt/work" \
    overlay /mnt/new || fail "no layer over the root folder"
$busybox mount -t proc proc /mnt/new/proc
$busybox mount -t sysfs sysfs /mnt/new/sys
$busybox mount -t devtmpfs devtmpfs /mnt/new/dev
$busybox mkdir -p /mnt/new/dev/shm /mnt/new/dev/pts
$busybox mount -t tmpfs tmpfs /mnt/new/dev/shm
$busybox mount -t devpts devpts /mnt/new/dev/pts
$busybox mount -t tmpfs tmpfs /mnt/new/run
$busybox mount -t tracefs tracefs /mnt/new/sys/kernel/tracing
$busybox mkdir -p /mnt/new/run/rig
$busybox mount -t hostfs -o "$out" none /mnt/new/run/rig || fail "no shared folder"
$busybox ip link set lo up

$busybox chroot /mnt/new /bin/sh /run/rig/command </dev/null >/mnt/new/run/rig/output 2>&1
echo $? >/mnt/new/run/rig/status
$busybox sync
$busybox poweroff -f
