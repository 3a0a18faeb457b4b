#include "usart.h"

#include <simavr/avr_uart.h>
#include <simavr/sim_interrupts.h>
#include <simavr/sim_io.h>
#include <string.h>

enum { UCSRA = 0xc0, UCSRB = 0xc1, UBRRL = 0xc4, UBRRH = 0xc5, UDR = 0xc6 };
enum { RXC = 0x80, TXC = 0x40, UDRE = 0x20, DOR = 0x08, U2X = 0x02 };          /* UCSRA */
enum { RXCIE = 0x80, TXCIE = 0x40, UDRIE = 0x20, RXEN = 0x10, TXEN = 0x08 };   /* UCSRB */
enum { LINE = 1 << 18 };

static avr_t *avr;
static avr_uart_t *port; /* simavr's: its interrupt vectors are used, and nothing else of it */
static void (*on_sent)(uint8_t value);
static usart_counts_t counts;

static uint8_t line[LINE]; /* bytes on their way to the chip */
static unsigned line_first, line_last;
static double line_bit = 16e6 / 115200; /* cycles */

static uint8_t fifo[2], arriving, shift_in;
static unsigned waiting;
static int receiving, held;
static uint8_t shift_out, buffer_out;
static int sending, buffered;

static double chip_bit(void) {
  unsigned divisor = (avr->data[UBRRL] | (avr->data[UBRRH] & 15) << 8) + 1;
  return divisor * (avr->data[UCSRA] & U2X ? 8.0 : 16.0);
}

/* Ten bits that end more than half a bit off cannot be read. */
static int garbled(void) {
  double off = chip_bit() / line_bit - 1.0;
  if (off < 0.05 && off > -0.05) return 0;
  counts.garbled++;
  return 1;
}

static void flag(uint8_t bit, int set) {
  avr->data[UCSRA] = set ? avr->data[UCSRA] | bit : avr->data[UCSRA] & (uint8_t)~bit;
}

/* Flags as they are, and the interrupts that they ask for as long as they stand. */
static void settle(void) {
  flag(RXC, waiting > 0);
  flag(UDRE, !buffered);
  if (waiting && avr->data[UCSRB] & RXCIE) avr_raise_interrupt(avr, &port->rxc);
  if (!waiting) port->rxc.pending = 0;
  if (!buffered && avr->data[UCSRB] & UDRIE) avr_raise_interrupt(avr, &port->udrc);
  if (buffered) port->udrc.pending = 0;
}

/* -- the receiver */

static void deliver(void) {
  if (!held || waiting == 2) return;
  fifo[waiting++] = shift_in;
  held = 0;
  settle();
}

static avr_cycle_count_t on_line(avr_t *a, avr_cycle_count_t when, void *param) {
  (void)a;
  (void)param;
  if (receiving) { /* the middle of the stop bit */
    receiving = 0;
    if (avr->data[UCSRB] & RXEN && !garbled()) {
      shift_in = arriving;
      held = 1;
      deliver();
    }
    return when + (avr_cycle_count_t)(0.5 * line_bit + 0.5);
  }
  if (line_first == line_last) return 0;
  if (held) { /* a start bit, and the byte before has found no place */
    held = 0;
    counts.overruns++;
    flag(DOR, 1);
  }
  arriving = line[line_first++ % LINE];
  receiving = 1;
  return when + (avr_cycle_count_t)(9.5 * line_bit + 0.5);
}

void usart_line(const uint8_t *bytes, unsigned count) {
  while (count--) line[line_last++ % LINE] = *bytes++;
  if (!avr_cycle_timer_status(avr, on_line, NULL)) avr_cycle_timer_register(avr, 1, on_line, NULL);
}

static uint8_t read_udr(avr_t *a, avr_io_addr_t addr, void *param) {
  uint8_t value = fifo[0];
  (void)a;
  (void)param;
  if (waiting) {
    fifo[0] = fifo[1];
    waiting--;
  }
  flag(DOR, 0);
  port->rxc.pending = 0;
  deliver();
  settle();
  avr->data[addr] = value;
  return value;
}

/* -- the transmitter */

static avr_cycle_count_t on_byte_out(avr_t *a, avr_cycle_count_t when, void *param) {
  (void)a;
  (void)param;
  if (!garbled()) on_sent(shift_out);
  if (buffered) {
    shift_out = buffer_out;
    buffered = 0;
    settle();
    return when + (avr_cycle_count_t)(10 * chip_bit());
  }
  sending = 0;
  flag(TXC, 1);
  return 0;
}

static void write_udr(avr_t *a, avr_io_addr_t addr, uint8_t value, void *param) {
  (void)a;
  (void)addr;
  (void)param;
  if (!(avr->data[UCSRB] & TXEN) || buffered) return;
  port->udrc.pending = 0;
  if (sending) {
    buffer_out = value;
    buffered = 1;
  } else {
    shift_out = value;
    sending = 1;
    avr_cycle_timer_register(avr, (avr_cycle_count_t)(10 * chip_bit()), on_byte_out, NULL);
  }
  settle();
}

/* -- registers */

static void write_a(avr_t *a, avr_io_addr_t addr, uint8_t value, void *param) {
  (void)a;
  (void)addr;
  (void)param;
  if (value & TXC) flag(TXC, 0);
  flag(U2X, value & U2X);
}

static void write_b(avr_t *a, avr_io_addr_t addr, uint8_t value, void *param) {
  (void)a;
  (void)param;
  avr->data[addr] = value;
  if (!(value & RXEN)) waiting = held = 0;
  settle();
}

static void reset(avr_io_t *io) {
  (void)io;
  waiting = receiving = held = sending = buffered = 0;
  avr->data[UCSRA] = UDRE;
  if (line_first != line_last) avr_cycle_timer_register(avr, 1, on_line, NULL);
}

void usart_baud(double baud) { line_bit = avr->frequency / baud; }

usart_counts_t usart_counts(void) { return counts; }

void usart_begin(avr_t *a, void (*sent)(uint8_t value)) {
  static avr_io_t self = {.kind = "usart", .reset = reset};
  avr_io_t *io = a->io_port;
  avr = a;
  on_sent = sent;
  while (io && strcmp(io->kind, "uart")) io = io->next;
  port = (avr_uart_t *)io;
  port->io.reset = NULL;
  avr->io[AVR_DATA_TO_IO(UDR)].r.c = read_udr;
  avr->io[AVR_DATA_TO_IO(UDR)].w.c = write_udr;
  avr->io[AVR_DATA_TO_IO(UCSRA)].r.c = NULL;
  avr->io[AVR_DATA_TO_IO(UCSRA)].w.c = write_a;
  avr->io[AVR_DATA_TO_IO(UCSRB)].w.c = write_b;
  avr->io[AVR_DATA_TO_IO(UBRRL)].w.c = NULL;
  avr_register_io(avr, &self);
  reset(&self);
}
