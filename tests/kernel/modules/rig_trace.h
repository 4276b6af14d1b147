/* SPDX-License-Identifier: Apache-2.0 OR GPL-2.0-only */
/*
 * The trace event rig:rig_line, beside the kernel's own spi:* and i2c:* in one trace on one clock.
 *
 * The kernel has gpio:gpio_value, but gpiolib writes it before it calls the chip, in the order of
 * the request. This one is written by the chip itself: it shows the order on the wires.
 */
#undef TRACE_SYSTEM
#define TRACE_SYSTEM rig

#if !defined(RIG_TRACE_H) || defined(TRACE_HEADER_MULTI_READ)
#define RIG_TRACE_H

#include <linux/tracepoint.h>

TRACE_EVENT(rig_line,
	TP_PROTO(unsigned int line, bool level),
	TP_ARGS(line, level),
	TP_STRUCT__entry(
		__field(unsigned int, line)
		__field(unsigned int, level)
	),
	TP_fast_assign(
		__entry->line = line;
		__entry->level = level;
	),
	TP_printk("%u %u", __entry->line, __entry->level)
);

#endif

/* The kernel reads this file several times over, and has to be told where it is. */
#undef TRACE_INCLUDE_PATH
#define TRACE_INCLUDE_PATH .
#undef TRACE_INCLUDE_FILE
#define TRACE_INCLUDE_FILE rig_trace
#include <trace/define_trace.h>
