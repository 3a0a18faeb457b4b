/* ESP32, ESP32-S3 and ESP32-C3 with Espressif's Arduino core 3: a general-purpose timer, the serial port or the chip's own USB,
   the RTC's watchdog, Wi-Fi. Loop and interrupt run on the core that setup() runs on. */
#pragma once
#include <Arduino.h>
#include <esp_random.h>
#include <esp_system.h>
#include <esp_timer.h>
#include <hal/wdt_hal.h>
#include <soc/gpio_reg.h>
#include <soc/rtc.h>
#include "chip_usb.h"

#define CHIP_FLASH
static inline uint32_t chip_flash32(const uint32_t *at) { return *at; }

static const uint16_t CHIP_QUEUE_BYTES = 1000; /* as on the Uno: some 50 commands of eight channels */

/* -- time */

static inline uint32_t chip_us() { return (uint32_t)esp_timer_get_time(); }
static inline uint32_t chip_ms() { return (uint32_t)(esp_timer_get_time() / 1000); }

struct ChipUndisturbed {
  uint32_t before;
  ChipUndisturbed() : before((uint32_t)portSET_INTERRUPT_MASK_FROM_ISR()) {}
  ~ChipUndisturbed() { portCLEAR_INTERRUPT_MASK_FROM_ISR(before); }
};

/* -- pins that stay low or open while the chip starts */

#if CONFIG_IDF_TARGET_ESP32
static const uint8_t SERVO_PINS[] = {18, 19, 21, 22, 23, 25, 26, 27};
constexpr bool chip_relay_pin(int pin) { return pin == 13 || pin == 32 || pin == 33; }
#elif CONFIG_IDF_TARGET_ESP32S3
static const uint8_t SERVO_PINS[] = {4, 5, 6, 7, 8, 9, 10, 11};
constexpr bool chip_relay_pin(int pin) { return pin >= 12 && pin <= 17; }
#elif CONFIG_IDF_TARGET_ESP32C3
static const uint8_t SERVO_PINS[] = {0, 1, 3, 4, 5, 6, 7};
constexpr bool chip_relay_pin(int pin) { return pin == 10; }
#else
#error "dermis_servos knows ESP32, ESP32-S3 and ESP32-C3 of this family: the others' pins and timers were not looked at."
#endif
static const uint8_t CHIP_SERVOS = sizeof SERVO_PINS;

typedef uint32_t ChipPin; /* its bit */
static inline void chip_high(ChipPin pin) { REG_WRITE(GPIO_OUT_W1TS_REG, pin); }
static inline void chip_low(ChipPin pin) { REG_WRITE(GPIO_OUT_W1TC_REG, pin); }

static inline void begin_output(uint8_t pin, bool on) {
  digitalWrite(pin, on ? HIGH : LOW); /* before it is an output: no moment at the other level */
  pinMode(pin, OUTPUT);
  digitalWrite(pin, on ? HIGH : LOW);
}

static inline ChipPin chip_servo_pin(uint8_t channel) {
  REG_WRITE(GPIO_OUT_W1TC_REG, 1u << SERVO_PINS[channel]);
  begin_output(SERVO_PINS[channel], false);
  return 1u << SERVO_PINS[channel];
}

static inline void chip_relay_begin(uint8_t pin, bool on) { begin_output(pin, on); }
static inline void chip_relay(uint8_t pin, bool on) { digitalWrite(pin, on ? HIGH : LOW); }

/* -- the pulses' timer: 2 MHz */

typedef uint32_t ChipTicks;
static const uint8_t CHIP_TICKS_A_US = 2;
static const uint8_t CHIP_EARLY = 40;
static hw_timer_t *pulse_timer = nullptr;

#define CHIP_ON_TIMER static void IRAM_ATTR on_pulse(void)
static void on_pulse(void);

static inline ChipTicks chip_timer_now() { return (ChipTicks)timerRead(pulse_timer); }

/* The timer has 64 bits, and asks for the interrupt at once where a tick has passed. */
static inline void chip_timer_next(ChipTicks at) {
  uint64_t now = timerRead(pulse_timer);
  timerAlarm(pulse_timer, now + (uint64_t)(int64_t)(int32_t)(at - (ChipTicks)now), false, 0);
}

static inline ChipTicks chip_timer_begin(ChipTicks ahead) {
  pulse_timer = timerBegin(1000000u * CHIP_TICKS_A_US);
  timerAttachInterrupt(pulse_timer, on_pulse);
  ChipTicks first = chip_timer_now() + ahead;
  chip_timer_next(first);
  return first;
}

/* -- the line */

static inline void chip_line_begin(uint32_t baud) {
  Serial.setRxBufferSize(1024);
  Serial.setTxBufferSize(512);
  Serial.begin(baud);
}

/* -- the chip's own watchdog: it resets the chip without a word, so that no pin stays high while the core reports a crash */

static const uint16_t CHIP_WATCHDOG_MS = 500;
static wdt_hal_context_t chip_watchdog;

static inline void chip_watchdog_begin() {
  wdt_hal_init(&chip_watchdog, WDT_RWDT, 0, false);
  wdt_hal_write_protect_disable(&chip_watchdog);
  uint32_t ticks = (uint32_t)((uint64_t)rtc_clk_slow_freq_get_hz() * CHIP_WATCHDOG_MS / 1000);
  wdt_hal_config_stage(&chip_watchdog, WDT_STAGE0, ticks, WDT_STAGE_ACTION_RESET_RTC);
  wdt_hal_enable(&chip_watchdog);
  wdt_hal_write_protect_enable(&chip_watchdog);
}

static inline void chip_watchdog_feed() {
  wdt_hal_write_protect_disable(&chip_watchdog);
  wdt_hal_feed(&chip_watchdog);
  wdt_hal_write_protect_enable(&chip_watchdog);
}

/* -- Wi-Fi, and what is kept in flash */

#ifdef DERMIS_WIFI
#include <Preferences.h>
#include <WiFi.h>
#include <lwip/sockets.h>

#define CHIP_WIFI

struct ChipPeer {
  uint32_t address; /* as in the packet */
  uint16_t port;
  bool operator==(const ChipPeer &other) const { return address == other.address && port == other.port; }
};

static int udp_socket = -1;

static inline void chip_random(uint8_t *to, uint8_t size) { esp_fill_random(to, size); } /* true numbers: its radio is on */
static inline void chip_restart() { esp_restart(); }

static inline bool chip_keep(const uint8_t *bytes, uint8_t size) {
  Preferences flash;
  bool kept = flash.begin("dermis", false) && flash.putBytes("pair", bytes, size) == size;
  flash.end();
  return kept;
}

static inline bool chip_kept(uint8_t *bytes, uint8_t size) {
  Preferences flash;
  bool kept = flash.begin("dermis", true) && flash.getBytes("pair", bytes, size) == size;
  flash.end();
  return kept;
}

static inline void chip_wifi_begin(const char *network, const char *password, uint16_t port) {
  WiFi.persistent(false); /* else it writes into flash when it pleases */
  WiFi.mode(WIFI_STA);
  WiFi.setSleep(false); /* else what comes waits for the next beacon, a tenth of a second */
  WiFi.setAutoReconnect(true);
  WiFi.begin(network, *password ? password : nullptr);
  sockaddr_in any = {};
  any.sin_family = AF_INET;
  any.sin_port = htons(port);
  udp_socket = lwip_socket(AF_INET, SOCK_DGRAM, 0);
  if (udp_socket >= 0) lwip_bind(udp_socket, (const sockaddr *)&any, sizeof any);
}

static inline uint32_t chip_wifi_address() { return WiFi.status() == WL_CONNECTED ? (uint32_t)WiFi.localIP() : 0; }

static inline uint16_t chip_udp_receive(ChipPeer &from, uint8_t *to, uint16_t room) {
  sockaddr_in who = {};
  socklen_t size = sizeof who;
  if (udp_socket < 0) return 0;
  int got = lwip_recvfrom(udp_socket, to, room, MSG_DONTWAIT, (sockaddr *)&who, &size);
  from = {who.sin_addr.s_addr, who.sin_port};
  return got > 0 ? (uint16_t)got : 0;
}

/* What the network has no room for is lost, as on the air. */
static inline void chip_udp_send(const ChipPeer &to, const uint8_t *bytes, uint16_t size) {
  sockaddr_in who = {};
  who.sin_family = AF_INET;
  who.sin_port = to.port;
  who.sin_addr.s_addr = to.address;
  lwip_sendto(udp_socket, bytes, size, MSG_DONTWAIT, (const sockaddr *)&who, sizeof who);
}
#endif
