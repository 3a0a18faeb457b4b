"""What holds where neither an object nor its preset says anything: effects are on, but of amplitude 0."""

from __future__ import annotations

# name -> SI value; switches 0 or 1
BODY: dict[str, float] = {
    "friction": 0.6,
    "mass": 1.0,
    "transient_on": 1.0,
    "transient_amplitude": 0.0,
    "transient_decay": 60.0,
    "transient_frequency": 100.0,
    "texture_on": 1.0,
    "texture_amplitude_x": 0.0,
    "texture_amplitude_y": 0.0,
    "texture_period_x": 0.004,
    "texture_period_y": 0.004,
    "texture_speed_threshold": 0.005,
    "weight_on": 1.0,
    "weight_acceleration": 0.0,
    "weight_gravity": 0.0,
    "content_on": 0.0,
    "content_amplitude": 0.0,
    "content_length": 0.03,
    "content_size": 0.02,
    "content_damping": 0.1,
    "held": 0.0,
}
FINGER: dict[str, float] = {
    "pattern_play": 0.0,
    "pattern_angle": 0.0,
    "pattern_frequency": 2.0,
    "pattern_amplitude": 1.0,
}
