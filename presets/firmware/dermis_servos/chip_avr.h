/* ATmega328P at 16 MHz: timer 1, USART 0, the chip's watchdog, and the Arduino core's clock and pins. */
#pragma once
#include "ring.h"
#include <Arduino.h>
#include <avr/interrupt.h>
#include <avr/pgmspace.h>
#include <avr/wdt.h>

#define CHIP_FLASH PROGMEM
static inline uint32_t chip_flash32(const uint32_t *at) { return pgm_read_dword(at); }

#ifdef DERMIS_PCA9685
static const uint16_t CHIP_QUEUE_BYTES = 300; /* so many channels take the rest */
static_assert(DERMIS_CHANNELS <= 32, "DERMIS_CHANNELS: this chip's memory is enough for 32 with PCA9685 boards");
#else
static const uint16_t CHIP_QUEUE_BYTES = 1000; /* half of its memory */
#endif

/* -- time */

static inline uint32_t chip_ms() { return millis(); }
static inline uint32_t chip_us() { return micros(); }

struct ChipUndisturbed {
  uint8_t before;
  ChipUndisturbed() : before(SREG) { cli(); }
  ~ChipUndisturbed() { SREG = before; }
};

/* -- pins */

static const uint8_t CHIP_SERVOS = 8; /* pins 2 to 9 */
static const uint8_t FIRST_PIN = 2;

struct ChipPin {
  volatile uint8_t *port;
  uint8_t mask;
};

static inline void chip_high(const ChipPin &pin) { *pin.port |= pin.mask; }
static inline void chip_low(const ChipPin &pin) { *pin.port &= (uint8_t)~pin.mask; }

static inline ChipPin chip_servo_pin(uint8_t channel) {
  uint8_t pin = FIRST_PIN + channel;
  pinMode(pin, OUTPUT);
  digitalWrite(pin, LOW);
  return {portOutputRegister(digitalPinToPort(pin)), digitalPinToBitMask(pin)};
}

/* Not 0 and 1, the line; not the servos'; not 13, which bootloaders blink; not A6 and A7, which are inputs; not A4 and A5
   where they are I2C. */
#ifdef DERMIS_PCA9685
constexpr int LAST_RELAY_PIN = A3;
#else
constexpr int LAST_RELAY_PIN = A5;
#endif
constexpr bool chip_relay_pin(int pin) { return (pin >= 10 && pin <= 12) || (pin >= A0 && pin <= LAST_RELAY_PIN); }
static inline void chip_relay_begin(uint8_t pin, bool on) {
  digitalWrite(pin, on ? HIGH : LOW); /* before it is an output: no moment at the other level */
  pinMode(pin, OUTPUT);
}
static inline void chip_relay(uint8_t pin, bool on) { digitalWrite(pin, on ? HIGH : LOW); }

/* -- the pulses' timer: timer 1, a tick each 8 clocks */

typedef uint16_t ChipTicks;
static const uint8_t CHIP_TICKS_A_US = 2;
static const uint8_t CHIP_EARLY = 30; /* No other interrupt takes these 15 us. No more of them: while the pulses' interrupt
                                         waits the port holds two bytes, and 41 us at 500,000 baud are too many. */

#define CHIP_ON_TIMER ISR(TIMER1_COMPA_vect)

static inline ChipTicks chip_timer_now() { return TCNT1; }
static inline void chip_timer_next(ChipTicks at) { OCR1A = at; }

static inline ChipTicks chip_timer_begin(ChipTicks ahead) {
  TCCR1A = 0;
  TCCR1B = _BV(CS11);
  ChipTicks first = TCNT1 + ahead;
  OCR1A = first;
  TIFR1 = _BV(OCF1A);
  TIMSK1 = _BV(OCIE1A);
  return first;
}

/* -- the line: USART 0, lean enough for half a million baud, which leaves 320 cycles for each byte, there and back.
   It takes the place of the core's Serial, which must not be used beside it. */

static const uint8_t CHIP_LINE_ROOM = 128; /* 2.5 ms at 500,000 baud */
static Ring<128> line_in;
static Ring<CHIP_LINE_ROOM> line_out;

ISR(USART_RX_vect) {
  uint8_t byte = UDR0;
  if (line_in.room()) line_in.put(byte); /* else it is lost, and the check sum of its frame says so */
}

ISR(USART_UDRE_vect) {
  if (line_out.held()) UDR0 = line_out.take();
  else UCSR0B &= (uint8_t)~_BV(UDRIE0);
}

/* With two clocks a bit and ten bits a byte, both ends together may be 4.3 % apart (data sheet, table 19-2): half for each. */
constexpr uint16_t divisor_of(uint32_t baud) { return (uint16_t)((F_CPU / 4 / baud - 1) / 2); }
constexpr bool reaches(uint32_t baud, uint32_t made) { return (made > baud ? made - baud : baud - made) <= baud / 46; }
constexpr bool chip_line_baud(uint32_t baud) { return reaches(baud, F_CPU / 8 / (divisor_of(baud) + 1ul)); }

static inline void chip_line_begin(uint32_t baud) {
  UBRR0 = divisor_of(baud);
  UCSR0A = _BV(U2X0);
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
  UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
}

static inline uint8_t chip_line_waiting() { return line_in.held(); }
static inline uint8_t chip_line_take() { return line_in.take(); }
static inline uint8_t chip_line_room() { return line_out.room(); }
static inline void chip_line_put(uint8_t byte) { line_out.put(byte); }
static inline void chip_line_send() { UCSR0B |= _BV(UDRIE0); }

/* -- I2C: the two-wire interface on A4 (SDA) and A5 (SCL), an interrupt a byte */

#ifdef DERMIS_PCA9685
#define CHIP_I2C
static const uint32_t I2C_HZ = 400000;
static volatile bool i2c_going = false, i2c_good = false;
static volatile uint8_t i2c_left = 0;
static const uint8_t *volatile i2c_next = 0;
static uint8_t i2c_address = 0;

ISR(TWI_vect) {
  uint8_t status = TWSR & 0xF8;
  if (status == 0x08) { /* START is out */
    TWDR = (uint8_t)(i2c_address << 1);
    TWCR = _BV(TWINT) | _BV(TWEN) | _BV(TWIE);
  } else if ((status == 0x18 || status == 0x28) && i2c_left) { /* address or byte acknowledged */
    TWDR = *i2c_next;
    i2c_next = i2c_next + 1;
    i2c_left = (uint8_t)(i2c_left - 1);
    TWCR = _BV(TWINT) | _BV(TWEN) | _BV(TWIE);
  } else {
    i2c_good = status == 0x28;
    TWCR = _BV(TWINT) | _BV(TWEN) | _BV(TWSTO);
    i2c_going = false;
  }
}

static inline void chip_i2c_begin() {
  TWCR = 0;
  TWSR = 0;
  TWBR = (uint8_t)((F_CPU / I2C_HZ - 16) / 2);
  i2c_going = false;
}

static inline void chip_i2c_send(uint8_t address, const uint8_t *bytes, uint8_t size) {
  i2c_address = address;
  i2c_next = bytes;
  i2c_left = size;
  i2c_good = false;
  i2c_going = true;
  TWCR = _BV(TWINT) | _BV(TWEN) | _BV(TWIE) | _BV(TWSTA);
}

static inline bool chip_i2c_busy() { return i2c_going; }
static inline bool chip_i2c_acknowledged() { return i2c_good; }
#endif

/* -- the chip's own watchdog */

static const uint16_t CHIP_WATCHDOG_MS = 250;
static inline void chip_watchdog_begin() { wdt_enable(WDTO_250MS); }
static inline void chip_watchdog_feed() { wdt_reset(); }

/* After a reset by the watchdog it goes on, at 16 ms: off with it before anything else takes time. A bootloader that
   comes first has to do the same; README.md says which does not. */
void stop_watchdog(void) __attribute__((naked, used, section(".init3")));
void stop_watchdog(void) {
  MCUSR = 0;
  wdt_disable();
}
