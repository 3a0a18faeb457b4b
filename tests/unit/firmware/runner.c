/* Runs a firmware in simavr, a command at a time from standard input, so that a test turns the clock:

     S hex        put bytes into the UART's receiver, as fast as 115200 baud allows
     R us         run for that long
   After each command: lines 'U hex' (what the firmware sent) and 'P pin start_cycles width_cycles' (a pulse that has
   ended), then '.'
*/
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static avr_t *avr;
static avr_cycle_count_t rising[20];
static unsigned char waiting[1 << 16];
static unsigned first, last;
static avr_cycle_count_t byte_due;

static void on_pin(struct avr_irq_t *irq, uint32_t value, void *param) {
  int pin = (int)(long)param;
  (void)irq;
  if (value) {
    rising[pin] = avr->cycle;
  } else if (rising[pin]) {
    printf("P %d %llu %llu\n", pin, (unsigned long long)rising[pin], (unsigned long long)(avr->cycle - rising[pin]));
    rising[pin] = 0;
  }
}

static void on_sent(struct avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  (void)param;
  printf("U %02x\n", value & 0xff);
}

static void run(avr_cycle_count_t cycles) {
  avr_cycle_count_t end = avr->cycle + cycles;
  avr_irq_t *input = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
  while (avr->cycle < end) {
    if (first != last && avr->cycle >= byte_due) {
      avr_raise_irq(input, waiting[first++ & 0xffff]);
      byte_due = avr->cycle + 1389; /* 16 MHz * 10 bits / 115200 */
    }
    int state = avr_run(avr);
    if (state == cpu_Done || state == cpu_Crashed) {
      fprintf(stderr, "the firmware crashed\n");
      exit(3);
    }
  }
}

int main(int argc, char **argv) {
  elf_firmware_t firmware;
  char line[1 << 16];
  if (argc != 2) return 2;
  memset(&firmware, 0, sizeof firmware);
  if (elf_read_firmware(argv[1], &firmware)) return 2;
  strcpy(firmware.mmcu, "atmega328p");
  firmware.frequency = 16000000;
  avr = avr_make_mcu_by_name(firmware.mmcu);
  if (!avr) return 2;
  avr_init(avr);
  avr_load_firmware(avr, &firmware);
  uint32_t flags = 0;
  avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_sent, NULL);
  for (int pin = 2; pin < 14; pin++) /* Arduino's numbers: 0-7 are port D, 8-13 port B */
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(pin < 8 ? 'D' : 'B'), pin < 8 ? pin : pin - 8),
                            on_pin, (void *)(long)pin);
  while (fgets(line, sizeof line, stdin)) {
    if (line[0] == 'S') {
      unsigned value;
      for (char *p = line + 2; sscanf(p, "%2x", &value) == 1; p += 2) waiting[last++ & 0xffff] = (unsigned char)value;
    } else if (line[0] == 'R') {
      run((avr_cycle_count_t)(atof(line + 2) * 16.0));
    }
    puts(".");
    fflush(stdout);
  }
  return 0;
}
