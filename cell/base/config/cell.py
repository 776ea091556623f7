"""Contents of cell.yaml: settings of the controller and those of the twin."""

from cell.base.config.settings import CellSettings
from drivers.twin.settings import TwinSettings


class CellFile(CellSettings):
    """Contents of cell.yaml: settings of the controller and those of the twin."""

    twin: TwinSettings

    @property
    def controller(self) -> CellSettings:
        """Settings that the controller may use: all but those of the twin."""
        return CellSettings.model_validate(
            self.model_dump(by_alias=True, exclude={"twin"})
        )
