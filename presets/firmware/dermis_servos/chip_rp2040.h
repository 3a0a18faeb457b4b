/* RP2040 (Raspberry Pi Pico and others) with the Arduino core of Earle Philhower: its microsecond timer's alarm 1, USB,
   the chip's watchdog, I2C 0. Loop and interrupt run on core 0. */
#pragma once
#include <Arduino.h>
#include <hardware/gpio.h>
#include <hardware/i2c.h>
#include <hardware/irq.h>
#include <hardware/sync.h>
#include <hardware/timer.h>
#include <hardware/watchdog.h>
#include "chip_usb.h"

#define CHIP_FLASH
static inline uint32_t chip_flash32(const uint32_t *at) { return *at; }

static const uint16_t CHIP_QUEUE_BYTES = 1000; /* as on the Uno: some 50 commands of eight channels */

/* -- time */

static inline uint32_t chip_us() { return time_us_32(); }
static inline uint32_t chip_ms() { return (uint32_t)(time_us_64() / 1000); }

struct ChipUndisturbed {
  uint32_t before;
  ChipUndisturbed() : before(save_and_disable_interrupts()) {}
  ~ChipUndisturbed() { restore_interrupts(before); }
};

/* -- pins */

static const uint8_t CHIP_SERVOS = 8; /* GP2 to GP9 */
static const uint8_t FIRST_PIN = 2;
typedef uint8_t ChipPin;
static inline void chip_high(ChipPin pin) { gpio_put(pin, true); }
static inline void chip_low(ChipPin pin) { gpio_put(pin, false); }

static inline void begin_output(uint8_t pin, bool on) {
  gpio_init(pin);
  gpio_put(pin, on); /* before it is an output: no moment at the other level */
  gpio_set_dir(pin, GPIO_OUT);
}

static inline ChipPin chip_servo_pin(uint8_t channel) {
  uint8_t pin = (uint8_t)(FIRST_PIN + channel);
  begin_output(pin, false);
  return pin;
}

constexpr bool chip_relay_pin(int pin) { return pin >= 10 && pin <= 22; } /* 23 to 25 are the board's own */
static inline void chip_relay_begin(uint8_t pin, bool on) { begin_output(pin, on); }
static inline void chip_relay(uint8_t pin, bool on) { gpio_put(pin, on); }

/* -- the pulses' timer: a tick a microsecond; alarm 3 is the SDK's own */

typedef uint32_t ChipTicks;
static const uint8_t CHIP_TICKS_A_US = 1;
static const uint8_t CHIP_EARLY = 15;
static const uint ALARM = 1;

#ifndef DERMIS_PCA9685
#define CHIP_ON_TIMER static void on_pulse(void)
static void on_pulse(void);

static inline ChipTicks chip_timer_now() { return timer_hw->timerawl; }

/* An alarm whose tick has passed would come 71 minutes later, so then the interrupt is asked for at once. */
static inline void chip_timer_next(ChipTicks at) {
  timer_hw->alarm[ALARM] = at;
  if ((int32_t)(at - chip_timer_now()) <= 0) irq_set_pending(hardware_alarm_get_irq_num(ALARM));
}

static inline void on_alarm(void) {
  timer_hw->intr = 1u << ALARM;
  on_pulse();
}

static inline ChipTicks chip_timer_begin(ChipTicks ahead) {
  uint irq = hardware_alarm_get_irq_num(ALARM);
  hardware_alarm_claim(ALARM);
  irq_set_exclusive_handler(irq, on_alarm);
  irq_set_priority(irq, 0); /* above USB */
  hw_set_bits(&timer_hw->inte, 1u << ALARM);
  irq_set_enabled(irq, true);
  ChipTicks first = chip_timer_now() + ahead;
  timer_hw->alarm[ALARM] = first;
  return first;
}
#endif

/* -- the line: USB */

static inline void chip_line_begin(uint32_t baud) { Serial.begin(baud); }

/* -- I2C 0 on GP4 (SDA) and GP5 (SCL), fed as its buffer has room */

#define CHIP_I2C
static const uint8_t *i2c_next = nullptr;
static uint8_t i2c_left = 0;
static bool i2c_going = false, i2c_good = false;

static inline void chip_i2c_begin() {
  i2c_init(i2c0, 400000);
  for (uint pin = 4; pin <= 5; pin++) {
    gpio_set_function(pin, GPIO_FUNC_I2C);
    gpio_pull_up(pin);
  }
  i2c_going = false;
}

static inline void chip_i2c_send(uint8_t address, const uint8_t *bytes, uint8_t size) {
  i2c_hw_t *hw = i2c_get_hw(i2c0);
  hw->enable = 0;
  hw->tar = address;
  hw->enable = 1;
  (void)hw->clr_tx_abrt;
  (void)hw->clr_stop_det;
  i2c_next = bytes;
  i2c_left = size;
  i2c_good = false;
  i2c_going = true;
}

static inline bool chip_i2c_busy() {
  if (!i2c_going) return false;
  i2c_hw_t *hw = i2c_get_hw(i2c0);
  while (i2c_left && i2c_get_write_available(i2c0)) {
    hw->data_cmd = *i2c_next++ | (i2c_left == 1 ? I2C_IC_DATA_CMD_STOP_BITS : 0u);
    i2c_left--;
  }
  uint32_t seen = hw->raw_intr_stat;
  if (seen & I2C_IC_RAW_INTR_STAT_TX_ABRT_BITS) i2c_going = false; /* not acknowledged */
  else if (!i2c_left && (seen & I2C_IC_RAW_INTR_STAT_STOP_DET_BITS)) i2c_good = true, i2c_going = false;
  return i2c_going;
}

static inline bool chip_i2c_acknowledged() { return i2c_good; }

/* -- the chip's own watchdog */

static const uint16_t CHIP_WATCHDOG_MS = 250;
static inline void chip_watchdog_begin() { watchdog_enable(CHIP_WATCHDOG_MS, true); }
static inline void chip_watchdog_feed() { watchdog_update(); }
