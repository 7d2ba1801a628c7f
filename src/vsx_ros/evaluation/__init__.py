"""Fourth floor: judgement against the truth."""
