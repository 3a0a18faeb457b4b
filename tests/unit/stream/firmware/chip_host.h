/* The sketch's chip layer on a computer: the same sources, compiled into a library that host.c loads. Time, line and
   pins are host.c's; what differs from chip to chip can be chosen by the defines below. */
#pragma once
#include "ring.h"

#ifndef HOST_TIMER_BITS
#define HOST_TIMER_BITS 16
#endif
#ifndef HOST_TICKS_A_US
#define HOST_TICKS_A_US 2
#endif
#ifndef HOST_LINE_BYTES
#define HOST_LINE_BYTES 128
#endif
#ifndef HOST_QUEUE_BYTES
#define HOST_QUEUE_BYTES 1000
#endif
#ifndef HOST_SERVOS
#define HOST_SERVOS 8
#endif

/* What host.c provides. Each call lets some time pass, and interrupts come meanwhile unless they are held off. */
extern "C" {
uint64_t host_us(void);
void host_hold_off(int more);
void host_pin(uint8_t pin, int level);
void host_relay(uint8_t pin, int level);
uint64_t host_timer(uint32_t ticks_a_us);
void host_timer_at(uint64_t tick, uint32_t ticks_a_us);
void host_line_begin(uint32_t baud);
void host_line_send(void);
void host_watchdog(uint32_t ms);
void host_i2c_begin(void);
void host_i2c_send(uint8_t address, const uint8_t *bytes, uint8_t size);
int host_i2c_busy(void);
int host_i2c_acknowledged(void);
void host_random(uint8_t *to, uint8_t size);
int host_keep(const uint8_t *bytes, uint8_t size);
int host_kept(uint8_t *bytes, uint8_t size);
void host_restart(void);
void host_wifi_begin(void);
uint32_t host_wifi_address(void);
int host_udp_receive(uint32_t *address, uint16_t *port, uint8_t *to, uint16_t room);
void host_udp_send(uint32_t address, uint16_t port, const uint8_t *bytes, uint16_t size);

/* What it calls. */
void setup(void);
void loop(void);
void chip_on_timer(void);
void chip_on_received(uint8_t byte);
int chip_next_out(void);
}

#define CHIP_ON_TIMER void chip_on_timer(void)
#define CHIP_FLASH
static inline uint32_t chip_flash32(const uint32_t *at) { return *at; }

static const uint32_t CHIP_QUEUE_BYTES = HOST_QUEUE_BYTES;

static inline uint32_t chip_ms() { return (uint32_t)(host_us() / 1000); }
static inline uint32_t chip_us() { return (uint32_t)host_us(); }

struct ChipUndisturbed {
  ChipUndisturbed() { host_hold_off(1); }
  ~ChipUndisturbed() { host_hold_off(-1); }
};

static const uint8_t CHIP_SERVOS = HOST_SERVOS;
typedef uint8_t ChipPin;
static inline void chip_high(ChipPin pin) { host_pin(pin, 1); }
static inline void chip_low(ChipPin pin) { host_pin(pin, 0); }
static inline ChipPin chip_servo_pin(uint8_t channel) { return 2 + channel; }

constexpr bool chip_relay_pin(int pin) { return pin >= 2 + HOST_SERVOS; }
static inline void chip_relay_begin(uint8_t pin, bool on) { host_relay(pin, on); }
static inline void chip_relay(uint8_t pin, bool on) { host_relay(pin, on); }

template <int bits> struct TicksOf { typedef uint16_t Type; };
template <> struct TicksOf<32> { typedef uint32_t Type; };
typedef TicksOf<HOST_TIMER_BITS>::Type ChipTicks;
static const uint8_t CHIP_TICKS_A_US = HOST_TICKS_A_US;
static const uint16_t CHIP_EARLY = 15 * HOST_TICKS_A_US;

static inline ChipTicks chip_timer_now() { return (ChipTicks)host_timer(CHIP_TICKS_A_US); }

/* The timer meets a tick that has just passed one whole round later, as a real one does. */
static inline void chip_timer_next(ChipTicks at) {
  uint64_t now = host_timer(CHIP_TICKS_A_US);
  host_timer_at(now + (ChipTicks)(at - (ChipTicks)now), CHIP_TICKS_A_US);
}

static inline ChipTicks chip_timer_begin(ChipTicks ahead) {
  uint64_t first = host_timer(CHIP_TICKS_A_US) + ahead;
  host_timer_at(first, CHIP_TICKS_A_US);
  return (ChipTicks)first;
}

static const uint16_t CHIP_LINE_ROOM = HOST_LINE_BYTES;
static Ring<HOST_LINE_BYTES> line_in, line_out;

void chip_on_received(uint8_t byte) {
  if (line_in.room()) line_in.put(byte);
}

int chip_next_out(void) { return line_out.held() ? line_out.take() : -1; }

constexpr bool chip_line_baud(uint32_t baud) { return baud > 0; }
static inline void chip_line_begin(uint32_t baud) { host_line_begin(baud); }
static inline uint16_t chip_line_waiting() { return line_in.held(); }
static inline uint8_t chip_line_take() { return line_in.take(); }
static inline uint16_t chip_line_room() { return line_out.room(); }
static inline void chip_line_put(uint8_t byte) { line_out.put(byte); }
static inline void chip_line_send() { host_line_send(); }

#define CHIP_I2C
static inline void chip_i2c_begin() { host_i2c_begin(); }
static inline void chip_i2c_send(uint8_t address, const uint8_t *bytes, uint8_t size) { host_i2c_send(address, bytes, size); }
static inline bool chip_i2c_busy() { return host_i2c_busy(); }
static inline bool chip_i2c_acknowledged() { return host_i2c_acknowledged(); }

#ifdef DERMIS_WIFI
static const uint16_t CHIP_WATCHDOG_MS = 500;
#else
static const uint16_t CHIP_WATCHDOG_MS = 250;
#endif
static inline void chip_watchdog_begin() { host_watchdog(CHIP_WATCHDOG_MS); }
static inline void chip_watchdog_feed() { host_watchdog(CHIP_WATCHDOG_MS); }

#define CHIP_WIFI

struct ChipPeer {
  uint32_t address;
  uint16_t port;
  bool operator==(const ChipPeer &other) const { return address == other.address && port == other.port; }
};

static inline void chip_random(uint8_t *to, uint8_t size) { host_random(to, size); }
static inline bool chip_keep(const uint8_t *bytes, uint8_t size) { return host_keep(bytes, size); }
static inline bool chip_kept(uint8_t *bytes, uint8_t size) { return host_kept(bytes, size); }
static inline void chip_restart() { host_restart(); }
static inline void chip_wifi_begin(const char *, const char *, uint16_t) { host_wifi_begin(); }
static inline uint32_t chip_wifi_address() { return host_wifi_address(); }
static inline uint16_t chip_udp_receive(ChipPeer &from, uint8_t *to, uint16_t room) {
  return (uint16_t)host_udp_receive(&from.address, &from.port, to, room);
}
static inline void chip_udp_send(const ChipPeer &to, const uint8_t *bytes, uint16_t size) {
  host_udp_send(to.address, to.port, bytes, size);
}
