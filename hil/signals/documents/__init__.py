"""Files written by people: read strictly, each value knowing its line, every problem reported at once."""
