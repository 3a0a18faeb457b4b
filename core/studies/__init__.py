"""The papers' own questions, asked of presets and stimuli of one's choice."""
