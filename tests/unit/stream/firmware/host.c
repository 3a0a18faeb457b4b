/* Runs the sketch on this computer, compiled behind chip_host.h into a library, in simulated time. It takes the commands of
   runner.c and answers like it, in the same cycles of 16 MHz, so that one test drives both boards:

     B baud, S hex, R us   as there
     H 0 or 1              let the loop run, or hang
     T                     the pulses' timer interrupts no more
     A n                   so many PCA9685 boards answer, 1 at first
     Q hz                  their oscillator
     G board register      print a register
     D 0 or 1              the I2C bus works, or stands still
     N                     print the port of 127.0.0.1 that it listens at for datagrams; 0: it does not

   host LIBRARY START_US SEED: the clock begins at START_US; SEED draws how long each call of the chip layer takes. A reset
   by the chip's watchdog loads the library anew. */
#include "pca9685.h"
#include <arpa/inet.h>
#include <dlfcn.h>
#include <setjmp.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/socket.h>

#define NEVER UINT64_MAX
#define US 1000000ull   /* time is counted in picoseconds, so that each timer's ticks are whole */
#define CYCLE 62500ull
enum { LINE = 1 << 18, PINS = 256, FIFO = 3 }; /* a byte in the shift register, and two that wait, as in the ATmega328P */

static uint64_t now, planned;
static uint32_t seed;
static int held_off, hung, timer_dead;
static jmp_buf reset_point;

static const char *library;
static void *handle;
static void (*sketch_loop)(void), (*on_timer)(void), (*on_received)(uint8_t);
static int (*next_out)(void);

static uint64_t timer_due, watchdog_due;
static int timer_pending;

static uint8_t line[LINE];
static unsigned line_first, line_last;
static double line_baud = 115200, chip_baud;
static uint64_t line_done; /* when the byte that is on its way has come */
static uint8_t fifo[FIFO];
static unsigned in_fifo;
static unsigned long overruns, garbled;

static int sends, sending;
static uint8_t byte_out;
static uint64_t sent_at;

enum { OE_PIN = 12 }; /* of PCA9685 boards */
static uint64_t i2c_done = NEVER; /* when the write under way has ended */
static uint8_t i2c_address, i2c_bytes[256];
static unsigned i2c_size;
static int i2c_good, i2c_stuck;

static uint64_t rising[PINS];
static int levels[PINS]; /* of relays; -1: nobody has set it */

static void fail(const char *why) {
  fprintf(stderr, "%s\n", why);
  exit(3);
}

/* -- the line */

static uint64_t byte_time(double baud) { return (uint64_t)(1e13 / baud); }

static int misread(void) {
  double off = chip_baud / line_baud - 1.0;
  if (off < 0.05 && off > -0.05) return 0;
  garbled++;
  return 1;
}

static void byte_came(void) {
  uint8_t byte = line[line_first++ % LINE];
  line_done = line_first == line_last ? NEVER : line_done + byte_time(line_baud);
  if (!chip_baud || misread()) return;
  if (in_fifo == FIFO) overruns++;
  else fifo[in_fifo++] = byte;
}

static void byte_left(void) {
  if (!misread()) printf("U %02x %llu\n", byte_out, (unsigned long long)(now / CYCLE));
  sending = 0;
}

static void send_next(void) {
  int next = next_out();
  sends = next >= 0;
  if (!sends) return;
  byte_out = (uint8_t)next;
  sending = 1;
  sent_at = now + byte_time(chip_baud);
}

static void receive_next(void) {
  uint8_t byte = fifo[0];
  memmove(fifo, fifo + 1, --in_fifo);
  on_received(byte);
}

/* -- time */

static void interrupts(void) {
  for (;;) {
    void (*handler)(void) = NULL;
    if (timer_pending) handler = on_timer;
    else if (in_fifo) handler = receive_next;
    else if (sends && !sending) handler = send_next;
    if (!handler) return;
    if (handler == on_timer) timer_pending = 0;
    held_off++;
    handler();
    held_off--;
  }
}

static uint64_t earliest(void) {
  uint64_t first = timer_due < line_done ? timer_due : line_done;
  if (sending && sent_at < first) first = sent_at;
  if (i2c_done < first) first = i2c_done;
  if (pca_next() < first) first = pca_next();
  return watchdog_due < first ? watchdog_due : first;
}

static void pulse_ended(unsigned channel, uint64_t start, uint64_t end) {
  printf("P %u %llu %llu\n", channel + 2, (unsigned long long)(start / CYCLE),
         (unsigned long long)((end - start + CYCLE / 2) / CYCLE));
}

static void pass(uint64_t span) {
  uint64_t end = now + span;
  do {
    uint64_t next = earliest() < end ? earliest() : end;
    if (next > now) now = next;
    if (watchdog_due <= now) longjmp(reset_point, 1);
    if (timer_due <= now) {
      timer_due = NEVER;
      timer_pending = !timer_dead;
    }
    if (line_done <= now) byte_came();
    if (sending && sent_at <= now) byte_left();
    if (i2c_done <= now) {
      i2c_done = NEVER;
      i2c_good = pca_write(now, i2c_address, i2c_bytes, i2c_size);
    }
    pca_pass(now, pulse_ended);
    if (!held_off) interrupts();
  } while (now < end);
}

/* A call of the chip layer takes 0.2 to 3.2 us, so that interrupts come in ever other places of the loop. */
static void take_time(void) {
  seed = seed * 1664525u + 1013904223u;
  pass(US / 5 + (seed >> 8) % (3 * US));
}

uint64_t host_us(void) {
  take_time();
  return now / US;
}

void host_hold_off(int more) {
  held_off += more;
  take_time();
}

uint64_t host_timer(uint32_t ticks_a_us) {
  pass(US / 10);
  return now / (US / 16) * ticks_a_us / 16;
}

void host_timer_at(uint64_t tick, uint32_t ticks_a_us) {
  timer_due = tick / ticks_a_us * US + tick % ticks_a_us * US / ticks_a_us;
}

void host_watchdog(uint32_t ms) {
  take_time();
  watchdog_due = now + ms * 1000 * US;
}

void host_i2c_begin(void) { i2c_done = NEVER; }

/* At 400 kHz a byte and its acknowledgement take 22.5 us; a bus that stands still never ends. */
void host_i2c_send(uint8_t address, const uint8_t *bytes, uint8_t size) {
  i2c_address = address;
  i2c_size = size;
  memcpy(i2c_bytes, bytes, size);
  i2c_good = 0;
  i2c_done = i2c_stuck ? NEVER - 1 : now + (size + 1) * 22500000ull;
  take_time();
}

int host_i2c_busy(void) {
  take_time();
  return i2c_done != NEVER;
}

int host_i2c_acknowledged(void) { return i2c_good; }

/* -- flash, which outlives a reset, and a real socket in place of Wi-Fi */

static uint8_t flash[256];
static unsigned in_flash;
static int udp = -1;

void host_random(uint8_t *to, uint8_t size) {
  if (getrandom(to, size, 0) != size) fail("no random numbers");
}

int host_keep(const uint8_t *bytes, uint8_t size) {
  memcpy(flash, bytes, in_flash = size);
  return 1;
}

int host_kept(uint8_t *bytes, uint8_t size) {
  if (in_flash != size) return 0;
  memcpy(bytes, flash, size);
  return 1;
}

void host_restart(void) { longjmp(reset_point, 1); }

static uint16_t udp_port(void) {
  struct sockaddr_in at;
  socklen_t size = sizeof at;
  return udp < 0 || getsockname(udp, (struct sockaddr *)&at, &size) ? 0 : ntohs(at.sin_port);
}

void host_wifi_begin(void) {
  struct sockaddr_in at = {.sin_family = AF_INET, .sin_addr = {htonl(INADDR_LOOPBACK)}};
  if (udp >= 0) return;
  udp = socket(AF_INET, SOCK_DGRAM, 0);
  if (udp < 0 || bind(udp, (struct sockaddr *)&at, sizeof at)) fail("no socket");
}

uint32_t host_wifi_address(void) { return udp < 0 ? 0 : htonl(INADDR_LOOPBACK); }

int host_udp_receive(uint32_t *address, uint16_t *port, uint8_t *to, uint16_t room) {
  struct sockaddr_in from = {0};
  socklen_t size = sizeof from;
  take_time();
  if (udp < 0) return 0;
  ssize_t got = recvfrom(udp, to, room, MSG_DONTWAIT | MSG_TRUNC, (struct sockaddr *)&from, &size);
  *address = from.sin_addr.s_addr;
  *port = from.sin_port;
  return got > 0 && got <= room ? (int)got : 0;
}

void host_udp_send(uint32_t address, uint16_t port, const uint8_t *bytes, uint16_t size) {
  struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = port, .sin_addr = {address}};
  take_time();
  if (udp >= 0) sendto(udp, bytes, size, MSG_DONTWAIT, (struct sockaddr *)&to, sizeof to);
}

void host_line_begin(uint32_t baud) { chip_baud = baud; }

void host_line_send(void) {
  sends = 1;
  take_time();
}

void host_pin(uint8_t pin, int level) {
  if (level && rising[pin] == NEVER) {
    rising[pin] = now;
  } else if (!level && rising[pin] != NEVER) {
    printf("P %d %llu %llu\n", pin, (unsigned long long)(rising[pin] / CYCLE),
           (unsigned long long)((now - rising[pin] + CYCLE / 2) / CYCLE));
    rising[pin] = NEVER;
  }
}

void host_relay(uint8_t pin, int level) {
  if (level == levels[pin]) return;
  levels[pin] = level;
  if (pin == OE_PIN) pca_oe(now, level);
  printf("L %d %d %llu\n", pin, level, (unsigned long long)(now / CYCLE));
}

/* -- the board */

static void *find(const char *name) {
  void *found = dlsym(handle, name);
  if (!found) fail(name);
  return found;
}

static void boot(void) {
  if (handle) dlclose(handle);
  if (dlopen(library, RTLD_NOW | RTLD_NOLOAD)) fail("the library keeps its memory");
  handle = dlopen(library, RTLD_NOW | RTLD_LOCAL);
  if (!handle) fail(dlerror());
  void (*sketch_setup)(void) = (void (*)(void))find("setup");
  sketch_loop = (void (*)(void))find("loop");
  on_timer = (void (*)(void))dlsym(handle, "chip_on_timer"); /* PCA9685 boards need none */
  on_received = (void (*)(uint8_t))find("chip_on_received");
  next_out = (int (*)(void))find("chip_next_out");
  held_off = timer_pending = sends = sending = 0;
  in_fifo = 0;
  chip_baud = 0;
  timer_due = watchdog_due = i2c_done = NEVER;
  for (int pin = 0; pin < PINS; pin++) {
    rising[pin] = NEVER;
    if (levels[pin] > 0) host_relay((uint8_t)pin, 0);
  }
  pca_oe(now, 1); /* nobody drives it now: its resistor does */
  sketch_setup();
}

static void run(uint64_t span) {
  planned += span;
  if (setjmp(reset_point)) boot();
  while (now < planned) {
    if (hung) pass(planned - now);
    else sketch_loop(), take_time();
  }
}

static void put(const char *hex) {
  char byte[3] = "";
  if (line_first == line_last) line_done = now + byte_time(line_baud);
  for (; hex[0] > ' ' && hex[1] > ' '; hex += 2) {
    memcpy(byte, hex, 2);
    line[line_last++ % LINE] = (uint8_t)strtoul(byte, NULL, 16);
  }
  if (line_first == line_last) line_done = NEVER;
}

int main(int argc, char **argv) {
  static char words[1 << 16];
  if (argc != 4) return 2;
  library = argv[1];
  now = planned = strtoull(argv[2], NULL, 10) * US;
  seed = (uint32_t)strtoul(argv[3], NULL, 10);
  line_done = NEVER;
  memset(levels, -1, sizeof levels);
  if (setjmp(reset_point)) fail("reset before it had begun");
  boot();
  while (fgets(words, sizeof words, stdin)) {
    if (words[0] == 'B') line_baud = atof(words + 2);
    else if (words[0] == 'S') put(words + 2);
    else if (words[0] == 'R') run((uint64_t)(atof(words + 2) * 1e6));
    else if (words[0] == 'H') hung = words[2] == '1';
    else if (words[0] == 'T') timer_dead = 1;
    else if (words[0] == 'A') pca_boards((unsigned)atoi(words + 2));
    else if (words[0] == 'Q') pca_clock(atof(words + 2));
    else if (words[0] == 'D') i2c_stuck = words[2] == '1';
    else if (words[0] == 'N') printf("G %u\n", udp_port());
    else if (words[0] == 'G') {
      unsigned board, at;
      if (sscanf(words + 2, "%u %u", &board, &at) == 2) printf("G %u\n", pca_register(board, (uint8_t)at));
    }
    printf("O %lu %lu\n.\n", overruns, garbled);
    fflush(stdout);
  }
  return 0;
}
