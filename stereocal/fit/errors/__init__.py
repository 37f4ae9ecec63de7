"""How certain a fit is: of points and lengths, of stated inputs, on frames held out."""
