"""A plan as plain rows."""

from typing import Any

from headstock.pipeline.planning.plan import Plan


def plan_rows(plan: Plan) -> list[dict[str, Any]]:
    """One row per stage, with the keys of ``summary.json`` and the estimates."""
    return [
        {
            "stage": stage.kind,
            "component": stage.component,
            "pose": stage.pose,
            "reason": stage.reason,
            "estimated_dofs": stage.estimated_dofs,
            "estimated_seconds": None if stage.estimated_seconds is None else round(stage.estimated_seconds, 2),
            "estimated_memory_mb": None if stage.estimated_memory_mb is None else round(stage.estimated_memory_mb, 1),
        }
        for stage in plan.stages
    ]
