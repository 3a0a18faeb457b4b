/* Teensy 4.0 and 4.1 (i.MX RT1062) with Teensyduino: timer GPT1, USB, watchdog 1. */
#pragma once
#include <Arduino.h>
#include "chip_usb.h"

#define CHIP_FLASH
static inline uint32_t chip_flash32(const uint32_t *at) { return *at; }

static const uint16_t CHIP_QUEUE_BYTES = 1000; /* as on the Uno: some 50 commands of eight channels */

/* -- time */

static inline uint32_t chip_us() { return micros(); }
static inline uint32_t chip_ms() { return millis(); }

struct ChipUndisturbed {
  uint32_t before;
  ChipUndisturbed() {
    asm volatile("mrs %0, primask" : "=r"(before));
    asm volatile("cpsid i" ::: "memory");
  }
  ~ChipUndisturbed() { asm volatile("msr primask, %0" ::"r"(before) : "memory"); }
};

/* -- pins */

static const uint8_t CHIP_SERVOS = 8; /* pins 2 to 9 */
static const uint8_t FIRST_PIN = 2;

struct ChipPin {
  volatile uint32_t *set, *clear;
  uint32_t mask;
};

static inline void chip_high(const ChipPin &pin) { *pin.set = pin.mask; }
static inline void chip_low(const ChipPin &pin) { *pin.clear = pin.mask; }

static inline void begin_output(uint8_t pin, bool on) {
  digitalWrite(pin, on ? HIGH : LOW); /* before it is an output: no moment at the other level */
  pinMode(pin, OUTPUT);
  digitalWrite(pin, on ? HIGH : LOW);
}

static inline ChipPin chip_servo_pin(uint8_t channel) {
  uint8_t pin = (uint8_t)(FIRST_PIN + channel);
  begin_output(pin, false);
  return {portSetRegister(pin), portClearRegister(pin), digitalPinToBitMask(pin)};
}

constexpr bool chip_relay_pin(int pin) { return (pin >= 10 && pin <= 12) || (pin >= 14 && pin <= 23); } /* 13: LED */
static inline void chip_relay_begin(uint8_t pin, bool on) { begin_output(pin, on); }
static inline void chip_relay(uint8_t pin, bool on) { digitalWrite(pin, on ? HIGH : LOW); }

/* -- the pulses' timer: GPT1 from the crystal of 24 MHz, divided by 12 */

typedef uint32_t ChipTicks;
static const uint8_t CHIP_TICKS_A_US = 2;
static const uint8_t CHIP_EARLY = 30;

#ifndef DERMIS_PCA9685
#define CHIP_ON_TIMER static void on_pulse(void)
static void on_pulse(void);

static inline ChipTicks chip_timer_now() { return GPT1_CNT; }

/* A tick that has passed would be met 36 minutes later, so then the interrupt is asked for at once. */
static inline void chip_timer_next(ChipTicks at) {
  GPT1_OCR1 = at;
  if ((int32_t)(at - GPT1_CNT) <= 0) NVIC_SET_PENDING(IRQ_GPT1);
}

static inline void on_compare(void) {
  GPT1_SR = GPT_SR_OF1;
  asm volatile("dsb"); /* the flag is down before the interrupt ends, or it would come twice */
  on_pulse();
}

static inline ChipTicks chip_timer_begin(ChipTicks ahead) {
  CCM_CCGR1 |= CCM_CCGR1_GPT1_BUS(CCM_CCGR_ON) | CCM_CCGR1_GPT1_SERIAL(CCM_CCGR_ON);
  GPT1_CR = 0;
  GPT1_CR = GPT_CR_CLKSRC(5) | GPT_CR_EN_24M | GPT_CR_FRR | GPT_CR_ENMOD;
  GPT1_PR = GPT_PR_PRESCALER24M(0) | GPT_PR_PRESCALER(11);
  GPT1_SR = 0x3F;
  GPT1_IR = GPT_IR_OF1IE;
  attachInterruptVector(IRQ_GPT1, on_compare);
  NVIC_SET_PRIORITY(IRQ_GPT1, 16); /* above USB */
  GPT1_CR |= GPT_CR_EN;
  ChipTicks first = GPT1_CNT + ahead;
  GPT1_OCR1 = first;
  NVIC_ENABLE_IRQ(IRQ_GPT1);
  return first;
}
#endif

/* -- the line: USB; begin() of this core waits for up to two seconds, and is not needed */

static inline void chip_line_begin(uint32_t) {}

/* -- the chip's own watchdog: half a second is its shortest */

static const uint16_t CHIP_WATCHDOG_MS = 500;

static inline void chip_watchdog_begin() {
  CCM_CCGR3 |= CCM_CCGR3_WDOG1(CCM_CCGR_ON);
  WDOG1_WMCR = 0; /* its power-down counter would reset the chip after 16 s */
  WDOG1_WCR = WDOG_WCR_WT(0) | WDOG_WCR_WDA | WDOG_WCR_SRS | WDOG_WCR_WDE;
}

static inline void chip_watchdog_feed() {
  WDOG1_WSR = 0x5555;
  WDOG1_WSR = 0xAAAA;
}
