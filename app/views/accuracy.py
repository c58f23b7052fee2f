"""How near the accuracy that a scene asks for a run came."""

from headstock.app.texts.bounded_values import accuracy_words
from headstock.app.views.view import View

VIEW = View(
    terminal=lambda run: accuracy_words(run.summary["accuracy"], run.summary.get("frf")),
)
