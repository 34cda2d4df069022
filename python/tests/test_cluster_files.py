"""The files for trying out a cluster are sound."""

from __future__ import annotations

from pathlib import Path

import pytest

CLUSTER = Path(__file__).parent.parent / "cluster"


def test_the_compose_file_has_its_roles() -> None:
    yaml = pytest.importorskip("yaml")
    compose = yaml.safe_load((CLUSTER / "compose.yaml").read_text())
    services = compose["services"]
    assert set(services) == {"store", "scheduler", "worker"}
    assert services["worker"]["deploy"]["replicas"] == 2
    for role in ("scheduler", "worker"):
        build = services[role]["build"]
        assert (CLUSTER / build["context"] / build["dockerfile"]).resolve() == (CLUSTER / "Dockerfile").resolve()
        assert services[role]["environment"]["AWS_SECRET_ACCESS_KEY"] == services["store"]["environment"]["MINIO_ROOT_PASSWORD"]
    assert "8786" in services["worker"]["command"] and "8786" in services["scheduler"]["command"]
