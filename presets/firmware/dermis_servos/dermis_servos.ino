/* Dermis: eight hobby servos on an Arduino Uno (or any board with an ATmega328P at 16 MHz).

   Speaks the native protocol, version 2 (presets/streaming_protocol.md), at 500,000 baud. With DERMIS_SERVO_ANIMATION defined
   it receives Blender Servo Animation's live mode instead, at 115,200 baud, positions in microseconds.

   Pins 2 to 9 are channels 0 to 7; wiring in README.md beside this file. A pulse is 1000 us for count 0 and 2000 us
   for count 65535. No pulse leaves the board before it has been armed. When nothing valid has arrived for as long as
   the sender asked for, the board goes to its safe state by itself.

   Needs nothing but the Arduino core: pulses come from timer 1, so pins 9 and 10 have no analogWrite(). Everything
   that depends on the chip is in its own header; chip.h selects it and says how to add another.
*/
#ifndef DERMIS_CHANNELS
#define DERMIS_CHANNELS 8 /* as many as your device preset drives: 1 to 8, with PCA9685 boards 1 to 16 a board */
#endif

#ifndef DERMIS_BAUD
#define DERMIS_BAUD 500000 /* exact at 16 MHz; at 1000000 the pulses' interrupt makes the chip lose bytes */
#endif

#ifndef DERMIS_ID
#define DERMIS_ID "DERMISU1" /* eight characters: give each board of yours another */
#endif

// #define DERMIS_RELAY_PIN 10 // a relay in the servos' supply: on while armed and on the way to safety
// #define DERMIS_PCA9685 1 // so many PCA9685 boards make the pulses instead of this chip: up to 16 servos each
// #define DERMIS_WIFI // ESP32: sealed datagrams over Wi-Fi instead of USB, which is for pairing then
// #define DERMIS_SERVO_ANIMATION // Blender Servo Animation's live mode instead of the native protocol

#ifndef DERMIS_UDP_PORT
#define DERMIS_UDP_PORT 3947 /* at which it listens, with DERMIS_WIFI */
#endif

#include "chip.h"
#ifdef CHIP_FLASH /* a chip that it knows; else the error of chip.h is the only one */
#ifdef DERMIS_SERVO_ANIMATION
#include "servo_animation.h"
#else
#include "native.h"
#endif
#endif
