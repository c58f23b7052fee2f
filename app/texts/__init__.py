"""Texts and table rows that terminal, report and CSV files share: values with ±, quantities, units.
Never colours or pictures.
"""
