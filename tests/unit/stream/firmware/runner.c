/* Runs a firmware in simavr, a command at a time from standard input, so that a test turns the clock:

     B baud         the line's pace, both ways (115200 at first)
     S hex          bytes on the line to the board, one after the other without a pause
     R us           run for that long
     F address hex  put another word into the flash, as 'F address cfff': hang there
     A n            so many PCA9685 boards answer on the I2C bus, 1 at first
     Q hz           their oscillator
     G board register   print a register
     M address      the first byte of memory from there on that is not zero: how deep the stack has been

   After each command: lines 'U hex cycle' (a byte has left the board), 'P pin start_cycle width_cycles' (a pulse has
   ended), 'L pin level cycle' (pins 10 to 13), 'O overruns garbled' (bytes that never reached the program, all in all),
   'F hex' (the word before), 'M address'; then '.'
*/
#include "pca9685.h"
#include "usart.h"

#include <simavr/avr_ioport.h>
#include <simavr/avr_twi.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_interrupts.h>
#include <simavr/sim_io.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static avr_t *avr;
static avr_cycle_count_t rising[20];

/* -- the I2C bus, with PCA9685 boards on it */

enum { OE_PIN = 12 };
#define PS(cycles) ((uint64_t)(cycles)*62500u)

static avr_irq_t *twi;
static uint8_t twi_address, twi_bytes[256];
static unsigned twi_count, twi_boards = 1;
static int twi_selected, twi_used;

static void acknowledge(void) { avr_raise_irq(twi + TWI_IRQ_INPUT, avr_twi_irq_msg(TWI_COND_ACK, twi_address, 1)); }

static void on_twi(struct avr_irq_t *irq, uint32_t value, void *param) {
  avr_twi_msg_irq_t message = {.u = {.v = value}};
  (void)irq;
  (void)param;
  twi_used = 1;
  if (message.u.twi.msg & TWI_COND_STOP) {
    if (twi_selected) pca_write(PS(avr->cycle), twi_address, twi_bytes, twi_count);
    twi_selected = 0;
  }
  if (message.u.twi.msg & TWI_COND_START) {
    twi_address = (uint8_t)(message.u.twi.addr >> 1);
    twi_count = 0;
    twi_selected = twi_address >= 0x40 && twi_address < 0x40 + twi_boards;
    if (twi_selected) acknowledge();
  }
  if (twi_selected && message.u.twi.msg & TWI_COND_WRITE && twi_count < sizeof twi_bytes) {
    twi_bytes[twi_count++] = message.u.twi.data;
    acknowledge();
  }
}

static void pulse_ended(unsigned channel, uint64_t start, uint64_t end) {
  printf("P %u %llu %llu\n", channel + 2, (unsigned long long)(start / PS(1)), (unsigned long long)((end - start + PS(1) / 2) / PS(1)));
}

static void on_pin(struct avr_irq_t *irq, uint32_t value, void *param) {
  int pin = (int)(long)param;
  (void)irq;
  if (pin >= 10) {
    printf("L %d %d %llu\n", pin, (int)value, (unsigned long long)avr->cycle);
    if (pin == OE_PIN) pca_oe(PS(avr->cycle), (int)value);
  } else if (value) {
    rising[pin] = avr->cycle;
  } else if (rising[pin]) {
    printf("P %d %llu %llu\n", pin, (unsigned long long)rising[pin], (unsigned long long)(avr->cycle - rising[pin]));
    rising[pin] = 0;
  }
}

static void on_sent(uint8_t value) { printf("U %02x %llu\n", value, (unsigned long long)avr->cycle); }

/* The chip takes four cycles to enter an interrupt; simavr takes none. */
static void on_interrupt(struct avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  (void)param;
  if (value) avr->cycle += 4;
}

static void run(avr_cycle_count_t cycles) {
  avr_cycle_count_t end = avr->cycle + cycles;
  while (avr->cycle < end) {
    avr->run_cycle_limit = end - avr->cycle;
    int state = avr_run(avr);
    if (twi_used && pca_next() <= PS(avr->cycle)) pca_pass(PS(avr->cycle), pulse_ended);
    if (state == cpu_Done || state == cpu_Crashed) {
      fprintf(stderr, "the firmware crashed\n");
      exit(3);
    }
  }
}

static void put(const char *hex) {
  static uint8_t bytes[1 << 15];
  unsigned count = 0, value;
  for (; count < sizeof bytes && sscanf(hex, "%2x", &value) == 1; hex += 2) bytes[count++] = (uint8_t)value;
  usart_line(bytes, count);
}

static void patch(const char *words) {
  unsigned address, word;
  if (sscanf(words, "%x %x", &address, &word) != 2) exit(2);
  printf("F %04x\n", avr->flash[address] | avr->flash[address + 1] << 8);
  avr->flash[address] = (uint8_t)word;
  avr->flash[address + 1] = (uint8_t)(word >> 8);
}

int main(int argc, char **argv) {
  elf_firmware_t firmware;
  static char line[1 << 16];
  if (argc != 2) return 2;
  memset(&firmware, 0, sizeof firmware);
  if (elf_read_firmware(argv[1], &firmware)) return 2;
  strcpy(firmware.mmcu, "atmega328p");
  firmware.frequency = 16000000;
  avr = avr_make_mcu_by_name(firmware.mmcu);
  if (!avr) return 2;
  avr_init(avr);
  avr_load_firmware(avr, &firmware);
  usart_begin(avr, on_sent);
  avr_irq_register_notify(avr_get_interrupt_irq(avr, AVR_INT_ANY) + AVR_INT_IRQ_RUNNING, on_interrupt, NULL);
  for (int pin = 2; pin < 14; pin++) /* Arduino's numbers: 0-7 are port D, 8-13 port B */
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(pin < 8 ? 'D' : 'B'), pin < 8 ? pin : pin - 8),
                            on_pin, (void *)(long)pin);
  twi = avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), 0);
  avr_irq_register_notify(twi + TWI_IRQ_OUTPUT, on_twi, NULL);
  while (fgets(line, sizeof line, stdin)) {
    if (line[0] == 'B') {
      usart_baud(atof(line + 2));
    } else if (line[0] == 'S') {
      put(line + 2);
    } else if (line[0] == 'R') {
      run((avr_cycle_count_t)(atof(line + 2) * 16.0));
    } else if (line[0] == 'F') {
      patch(line + 2);
    } else if (line[0] == 'A') {
      twi_boards = (unsigned)atoi(line + 2);
      pca_boards(twi_boards);
    } else if (line[0] == 'Q') {
      pca_clock(atof(line + 2));
    } else if (line[0] == 'G') {
      unsigned board, at;
      if (sscanf(line + 2, "%u %u", &board, &at) == 2) printf("G %u\n", pca_register(board, (uint8_t)at));
    } else if (line[0] == 'M') {
      unsigned long address = strtoul(line + 2, NULL, 16);
      while (address < avr->ramend && !avr->data[address]) address++;
      printf("M %lu\n", address);
    }
    printf("O %lu %lu\n.\n", usart_counts().overruns, usart_counts().garbled);
    fflush(stdout);
  }
  return 0;
}
