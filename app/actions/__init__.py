"""What each command does. Never the spelling of an option."""
