"""The structured singular value µ: bounds, certified over frequency, worst cases, sensitivities."""
