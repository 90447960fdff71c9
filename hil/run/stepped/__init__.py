"""World that is stepped from outside: vehicles, their ideal controller, clock."""
