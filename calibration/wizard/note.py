"""Observer that writes a wizard's results into its session folder."""

from calibration.wizard.news import TouchNews, ViewNews
from calibration.wizard.session import LATENCY, Row, SessionFolder


class Note:
    """Writes each processed image as a row; accepted ones with their picture."""

    def __init__(self, folder: SessionFolder) -> None:
        self._folder = folder

    def __call__(self, news: ViewNews | TouchNews) -> None:
        """Write the new results."""
        if isinstance(news, ViewNews):
            self._view(news)
        elif news.steps is not None:
            self._folder.keep(
                LATENCY,
                {
                    "arm": news.steps.arm.tolist(),
                    "seen": [(step.stamp, *step.pixel.tolist()) for step in news.steps.seen],
                },
            )
        else:
            self._touch(news)

    def _view(self, news: ViewNews) -> None:
        told = news.told
        if told is None or news.frame is None:
            return
        view = told.look.view
        corners = [] if view is None else zip(view.ids, view.image, strict=True)
        row = Row(
            number=told.number,
            refused=told.refused,
            corners=tuple((int(i), float(u), float(v)) for i, (u, v) in corners),
        )
        self._folder.add(row, news.frame.image if told.view is not None else None)

    def _touch(self, news: TouchNews) -> None:
        told = news.told
        if told is None or news.frame is None or news.pose is None:
            return
        x, z, pitch = news.pose.x, news.pose.z, news.pose.pitch
        centre = None if told.centre is None else (float(told.centre[0]), float(told.centre[1]))
        taken = told.taken
        row = Row(
            number=told.number,
            refused=told.refused,
            centre=centre,
            pose=(x, z, pitch) if taken is None else (*map(float, taken.place), pitch),
            again=taken is not None and taken.again,
        )
        self._folder.add(row, None if taken is None else news.frame.image)
