"""What a planned manoeuvre will tell: predicted errors of its parameters, and the manoeuvre that makes them small."""
