// SPDX-License-Identifier: Apache-2.0 OR GPL-2.0-only
/*
 * The door: /dev/rig, through which the module tells and asks a program in user space.
 *
 * One program at a time opens it. Each read() gives all events that wait and fit, whole, each as
 *
 *	u64 t_ns (CLOCK_MONOTONIC), u32 number, u16 kind, u16 length, then `length` bytes
 *
 * `number` is 0 for what is only told; what is asked wants a write() of
 *
 *	u32 number, s32 status (0 or a negative errno), then the bytes of the answer
 *
 * and a write() with number 0 moves inputs, two u32 each: line, and level (0 or 1), or 2 for a
 * line that is to be asked at each read.
 */
#include <linux/completion.h>
#include <linux/fs.h>
#include <linux/list.h>
#include <linux/miscdevice.h>
#include <linux/module.h>
#include <linux/mutex.h>
#include <linux/poll.h>
#include <linux/slab.h>
#include <linux/timekeeping.h>
#include <linux/uaccess.h>
#include <linux/wait.h>

#include "rig.h"

/*
 * What is still to be played when a message comes, lengthens that message's call; but each time the
 * teller has to wait costs two changes of the process.
 */
#define MOST_WAITING 64
#define LONGEST_WRITE 65536
#define PATIENCE (20 * HZ)

static bool alone;
module_param(alone, bool, 0644);
MODULE_PARM_DESC(alone, "with no program at /dev/rig, everything reads zero (default: EIO)");

struct header {
	u64 t_ns;
	u32 number;
	u16 kind;
	u16 length;
} __packed;

/* An event on its way out. */
struct event {
	struct list_head node;
	struct header header;
	u8 payload[];
};

/* Somebody who sleeps until the answer with this number is there; lives on the asker's stack. */
struct question {
	struct list_head node;
	struct completion answered;
	u32 number;
	int status;
	void *answer;
	size_t room;
};

/* Guards all that follows. A mutex, because everybody who comes here may sleep. */
static DEFINE_MUTEX(lock);
static LIST_HEAD(events);
static LIST_HEAD(questions);
static unsigned int waiting;
static u32 last_number;
static bool is_open;
/* Who sleeps here: the program that waits for an event, and tellers that wait for room. */
static DECLARE_WAIT_QUEUE_HEAD(readers);
static DECLARE_WAIT_QUEUE_HEAD(tellers);

/* With the lock held. The event's number is 0, or that of the question that is asked with it. */
static int put_event(enum rig_kind kind, const void *payload, size_t length, u32 number)
{
	struct event *event;

	if (length > U16_MAX)
		return -EMSGSIZE;
	event = kmalloc(sizeof(*event) + length, GFP_KERNEL);
	if (!event)
		return -ENOMEM;
	event->header.t_ns = ktime_get_ns();
	event->header.number = number;
	event->header.kind = kind;
	event->header.length = length;
	memcpy(event->payload, payload, length);
	list_add_tail(&event->node, &events);
	waiting++;
	wake_up_interruptible(&readers);
	return 0;
}

void rig_tell(enum rig_kind kind, const void *payload, size_t length)
{
	wait_event(tellers, READ_ONCE(waiting) < MOST_WAITING || !READ_ONCE(is_open));
	mutex_lock(&lock);
	if (is_open && put_event(kind, payload, length, 0))
		pr_err("rig: an event of kind %d was lost\n", kind);
	mutex_unlock(&lock);
}

static int nobody(void *answer, size_t room)
{
	if (!alone)
		return -EIO;
	memset(answer, 0, room);
	return 0;
}

int rig_ask(enum rig_kind kind, const void *payload, size_t length, void *answer, size_t room)
{
	struct question question = { .status = -EIO, .answer = answer, .room = room };
	int error;

	init_completion(&question.answered);
	mutex_lock(&lock);
	if (!is_open) {
		mutex_unlock(&lock);
		return nobody(answer, room);
	}
	if (!++last_number)
		last_number = 1;
	question.number = last_number;
	error = put_event(kind, payload, length, question.number);
	if (!error)
		list_add_tail(&question.node, &questions);
	mutex_unlock(&lock);
	if (error)
		return error;

	if (!wait_for_completion_timeout(&question.answered, PATIENCE)) {
		mutex_lock(&lock);
		/* The answer may have come between the end of patience and the lock. */
		if (!completion_done(&question.answered)) {
			list_del(&question.node);
			question.status = -ETIMEDOUT;
		}
		mutex_unlock(&lock);
	}
	return question.status;
}

/* With the lock held: wake who asked, with an answer or with an error. */
static void settle(struct question *question, int status)
{
	question->status = status;
	list_del(&question->node);
	complete(&question->answered);
}

static int answer_question(u32 number, int status, const u8 *bytes, size_t length)
{
	struct question *question;
	int result = -ESRCH;

	mutex_lock(&lock);
	list_for_each_entry(question, &questions, node) {
		if (question->number != number)
			continue;
		result = 0;
		if (!status && length == question->room)
			memcpy(question->answer, bytes, length);
		else if (!status)
			result = status = -EPROTO;
		settle(question, status);
		break;
	}
	mutex_unlock(&lock);
	return result;
}

static int move_inputs(const u8 *bytes, size_t length)
{
	u32 pair[2];

	if (length % sizeof(pair))
		return -EINVAL;
	for (; length; bytes += sizeof(pair), length -= sizeof(pair)) {
		memcpy(pair, bytes, sizeof(pair));
		if (pair[1] == 2)
			rig_gpio_ask_at_read(pair[0]);
		else
			rig_gpio_move_input(pair[0], pair[1]);
	}
	return 0;
}

static ssize_t door_write(struct file *file, const char __user *from, size_t size, loff_t *at)
{
	struct {
		u32 number;
		s32 status;
	} head;
	int error;
	u8 *bytes;

	if (size < sizeof(head) || size > LONGEST_WRITE)
		return -EINVAL;
	bytes = memdup_user(from, size);
	if (IS_ERR(bytes))
		return PTR_ERR(bytes);
	memcpy(&head, bytes, sizeof(head));
	if (head.number)
		error = answer_question(head.number, head.status, bytes + sizeof(head),
					size - sizeof(head));
	else
		error = move_inputs(bytes + sizeof(head), size - sizeof(head));
	kfree(bytes);
	return error ? error : size;
}

/* With the lock held: the first event out of the list, if it is there and fits. */
static struct event *take_event(size_t room)
{
	struct event *event = list_first_entry_or_null(&events, struct event, node);

	if (!event || sizeof(event->header) + event->header.length > room)
		return NULL;
	list_del(&event->node);
	waiting--;
	return event;
}

static int hand_over(const struct event *event, char __user *to)
{
	if (copy_to_user(to, &event->header, sizeof(event->header)) ||
	    copy_to_user(to + sizeof(event->header), event->payload, event->header.length))
		return -EFAULT;
	return 0;
}

/* As many events as are there: a selection tells two hundred, and a read() each would take longest. */
static ssize_t door_read(struct file *file, char __user *to, size_t size, loff_t *at)
{
	struct event *event;
	size_t length = 0;
	int error = 0;

	do {
		if (file->f_flags & O_NONBLOCK) {
			if (!READ_ONCE(waiting))
				return -EAGAIN;
		} else {
			error = wait_event_interruptible(readers, READ_ONCE(waiting));
			if (error)
				return error;
		}
		mutex_lock(&lock);
		while (!error && (event = take_event(size - length))) {
			error = hand_over(event, to + length);
			length += sizeof(event->header) + event->header.length;
			kfree(event);
		}
		/* There is one, and it alone is more than the reader has room for. */
		if (!error && !length && waiting)
			error = -EFAULT;
		mutex_unlock(&lock);
	} while (!error && !length);
	wake_up(&tellers);
	return error ? error : length;
}

static __poll_t door_poll(struct file *file, poll_table *table)
{
	poll_wait(file, &readers, table);
	return READ_ONCE(waiting) ? EPOLLIN | EPOLLRDNORM | EPOLLOUT : EPOLLOUT;
}

static int door_open(struct inode *inode, struct file *file)
{
	int error = 0;

	mutex_lock(&lock);
	if (is_open)
		error = -EBUSY;
	else
		WRITE_ONCE(is_open, true);
	mutex_unlock(&lock);
	return error ? error : nonseekable_open(inode, file);
}

/* The program is gone, however it went: nobody may go on sleeping for it. */
static int door_release(struct inode *inode, struct file *file)
{
	struct question *question, *next_question;
	struct event *event, *next_event;

	mutex_lock(&lock);
	WRITE_ONCE(is_open, false);
	list_for_each_entry_safe(question, next_question, &questions, node)
		settle(question, -EIO);
	list_for_each_entry_safe(event, next_event, &events, node) {
		list_del(&event->node);
		kfree(event);
	}
	waiting = 0;
	mutex_unlock(&lock);
	wake_up(&tellers);
	return 0;
}

static const struct file_operations door_operations = {
	.owner = THIS_MODULE,
	.open = door_open,
	.release = door_release,
	.read = door_read,
	.write = door_write,
	.poll = door_poll,
};

static struct miscdevice door = {
	.minor = MISC_DYNAMIC_MINOR,
	.name = "rig",
	.fops = &door_operations,
	.mode = 0600,
};

static int __init rig_start(void)
{
	int error = misc_register(&door);

	if (error)
		return error;
	error = rig_gpio_start();
	if (error)
		goto without_gpio;
	error = rig_spi_start();
	if (error)
		goto without_spi;
	error = rig_i2c_start();
	if (error)
		goto without_i2c;
	error = rig_firmware_start();
	if (error)
		goto without_firmware;
	return 0;

without_firmware:
	rig_i2c_end();
without_i2c:
	rig_spi_end();
without_spi:
	rig_gpio_end();
without_gpio:
	misc_deregister(&door);
	return error;
}

static void __exit rig_stop(void)
{
	rig_firmware_end();
	rig_i2c_end();
	rig_spi_end();
	rig_gpio_end();
	misc_deregister(&door);
}

module_init(rig_start);
module_exit(rig_stop);
/* What a bus driver needs, the kernel gives to modules under the GPL only. */
MODULE_LICENSE("GPL");
MODULE_DESCRIPTION("The buses of a Raspberry Pi, answered by a program");
