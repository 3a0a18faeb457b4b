/* Names and types as in the Pico SDK 2.2. */
#pragma once
#include <stdint.h>
typedef unsigned int uint;
typedef volatile uint32_t io_rw_32;
typedef const volatile uint32_t io_ro_32;
typedef void (*irq_handler_t)(void);

struct timer_hw_t { io_rw_32 alarm[4]; io_ro_32 timerawl; io_rw_32 intr, inte; };
extern timer_hw_t *const timer_hw;
uint32_t time_us_32(void);
uint64_t time_us_64(void);
uint hardware_alarm_get_irq_num(uint alarm_num);
void hardware_alarm_claim(uint alarm_num);
void hw_set_bits(io_rw_32 *addr, uint32_t mask);

void irq_set_pending(uint num);
void irq_set_exclusive_handler(uint num, irq_handler_t handler);
void irq_set_priority(uint num, uint8_t hardware_priority);
void irq_set_enabled(uint num, bool enabled);
uint32_t save_and_disable_interrupts(void);
void restore_interrupts(uint32_t status);

enum gpio_function_t { GPIO_FUNC_I2C = 3 };
enum { GPIO_OUT = 1 };
void gpio_init(uint gpio);
void gpio_put(uint gpio, bool value);
void gpio_set_dir(uint gpio, bool out);
void gpio_set_function(uint gpio, gpio_function_t fn);
void gpio_pull_up(uint gpio);

struct i2c_hw_t { io_rw_32 tar, data_cmd, enable; io_ro_32 raw_intr_stat, clr_tx_abrt, clr_stop_det; };
struct i2c_inst_t;
extern i2c_inst_t *const i2c0;
uint i2c_init(i2c_inst_t *i2c, uint baudrate);
i2c_hw_t *i2c_get_hw(i2c_inst_t *i2c);
uint32_t i2c_get_write_available(i2c_inst_t *i2c);
static const uint32_t I2C_IC_DATA_CMD_STOP_BITS = 0x200u;
static const uint32_t I2C_IC_RAW_INTR_STAT_TX_ABRT_BITS = 0x40u;
static const uint32_t I2C_IC_RAW_INTR_STAT_STOP_DET_BITS = 0x200u;

void watchdog_enable(uint32_t delay_ms, bool pause_on_debug);
void watchdog_update(void);
