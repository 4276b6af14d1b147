#!/bin/busybox sh
# The Pi's first process. Owns: modules, mounts, one command, the end of the machine.
# Must not know what is run: that is the file /command.
#
# The whole root is in memory. The first serial port takes what the command says, and then a line
# with its status; the second one is the console.
/bin/busybox mkdir -p /proc /sys /dev /tmp /run
/bin/busybox mount -t proc proc /proc
/bin/busybox mount -t sysfs sysfs /sys
/bin/busybox mount -t devtmpfs devtmpfs /dev
/bin/busybox mkdir -p /dev/shm
exec >/dev/console 2>&1

# Without a status, the run shows this console and fails.
fail() {
    echo "rig: $1"
    /bin/busybox sleep 1
    /bin/busybox reboot -f
}

for module in $(/bin/busybox cat /modules/order); do
    /bin/busybox insmod "/modules/$module" || fail "the module $module does not load"
done
/bin/busybox mount -t tracefs tracefs /sys/kernel/tracing || fail "there is no tracing"
/bin/busybox mount -t debugfs debugfs /sys/kernel/debug || fail "there is no debugfs"
/bin/busybox ip link set lo up
/bin/busybox --install -s /bin

# A Pi has no clock of its own: what is run was written a moment ago, by a machine that has one.
date -s "@$(stat -c %Y /command)" >/dev/null || fail "the date cannot be set"
stty -F /dev/ttyAMA0 raw
sh /command </dev/null >/dev/ttyAMA0 2>&1
echo "rig: status $?" >/dev/ttyAMA0
sleep 1
# The machine ends with a reset.
reboot -f
