"""Failures of the validation itself."""

from headstock.geometry.errors import HeadstockError


class UnknownCaseError(ValueError):
    """A case or group was asked for that does not exist; the message lists those that do (bad input, exit code 2)."""


class CampaignError(HeadstockError):
    """A fault campaign found something torn, wrong or left behind."""


class LadderError(HeadstockError):
    """A scene is not what a published study is about."""
