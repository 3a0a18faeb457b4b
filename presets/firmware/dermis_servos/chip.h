/* Selects the header of the chip that the sketch is compiled for. That header has all of the chip's registers and all of
   the Arduino core; no other file has any.

   To add a chip: write its header, select it here, and name it in the error below. The header provides
     CHIP_ON_TIMER            begins the function that the pulses' timer interrupts with
     CHIP_FLASH               keeps a table in flash, where memory is short; chip_flash32() reads it
     CHIP_SERVOS              servo pins that there are
     CHIP_QUEUE_BYTES         memory for timed commands
     CHIP_TICKS_A_US          ticks of the pulses' timer in a microsecond
     CHIP_EARLY               ticks that the timer's interrupt comes early, then to wait for the edge itself
     CHIP_LINE_ROOM           bytes of the line's buffer to the sender
     CHIP_WATCHDOG_MS         after which the chip's own watchdog resets it
     ChipTicks                unsigned integer as wide as the pulses' timer
     ChipPin                  a servo's pin, ready to be switched within the interrupt
     ChipUndisturbed          no interrupt comes while one of these lives; they may be nested
     chip_ms, chip_us         time since the start, modulo 2^32
     chip_servo_pin           makes a channel's pin a low output and returns it; chip_high, chip_low switch it
     chip_relay_pin           whether a pin may be the relay's; chip_relay_begin makes it an output that
                              begins at a level, chip_relay switches it
     chip_timer_begin         starts the timer, and returns the tick of the first interrupt, so many ticks from now
     chip_timer_next          sets the tick of the next interrupt, which is to come; chip_timer_now is the present one
     chip_line_begin          opens the line to the computer
     chip_line_waiting, chip_line_take     bytes that have come in, and the next of them
     chip_line_room, chip_line_put         room for bytes that go out, and one more of them; chip_line_send lets them go
     chip_watchdog_begin, chip_watchdog_feed
   and for PCA9685 boards, where the chip shall drive them
     CHIP_I2C                 defined
     chip_i2c_begin           (re)starts the I2C bus at 400 kHz and forgets what was under way
     chip_i2c_send            begins to write bytes to an address; they stay as they are while it is busy
     chip_i2c_busy, chip_i2c_acknowledged  whether that is still under way, and whether all of it was acknowledged
   and for Wi-Fi, where the chip has it
     CHIP_WIFI                defined
     ChipPeer                 who sent a datagram, and whom one goes to; comparable
     chip_random              fills bytes with true random numbers
     chip_keep, chip_kept     writes a record into flash, and reads it: whether it could
     chip_restart             begins anew
     chip_wifi_begin          joins a network, now and whenever it was lost, and listens at a port
     chip_wifi_address        its address there, 0 where it has none
     chip_udp_receive, chip_udp_send    a datagram that has come, 0 for none; one that goes out, or is lost
   Nothing of this may wait. The interrupt runs on the same processor as setup() and loop(). */
#pragma once

#if defined(DERMIS_CHIP)
#include DERMIS_CHIP
#elif defined(__AVR_ATmega328P__) && F_CPU == 16000000L
#include "chip_avr.h"
#elif defined(ARDUINO_ARCH_RP2040) && PICO_RP2040
#include "chip_rp2040.h"
#elif defined(__IMXRT1062__)
#include "chip_teensy4.h"
#elif defined(ARDUINO_ARCH_ESP32)
#include "chip_esp32.h"
#else
#error "dermis_servos knows ATmega328P at 16 MHz (Arduino Uno, Nano, Pro Mini 5 V), RP2040, Teensy 4 and ESP32. chip.h says how to add one."
#endif

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "dermis_servos copies numbers from packets as they are: it needs a little-endian chip."
#endif
