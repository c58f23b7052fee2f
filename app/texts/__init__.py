"""Words and rows without a screen: ± texts, CSV tables, mapped quantities. Never colours or pictures."""
