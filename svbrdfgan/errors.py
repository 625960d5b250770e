"""The errors this package raises. Every message says what was given, what was wanted and what to do."""


class SvbrdfganError(Exception):
    """Base of every error that is about the user's input or installation, not about a bug.

    Each argument is a sentence. It may quote files of strangers as they are: the command line prints each on one line
    by `svbrdfgan.utils.printable`, even where a name has line feeds.
    """

    def __str__(self) -> str:
        return "\n".join(map(str, self.args))


class ConfigError(SvbrdfganError):
    """A configuration or option is unknown, of the wrong type, or impossible; names the path of the key."""


class AssetError(SvbrdfganError):
    """A mesh, image, environment or stored file cannot be read, or does not hold what it should."""


class EmbeddingError(SvbrdfganError):
    """A mesh cannot be given the UV embedding that was asked for."""


class PluginError(SvbrdfganError):
    """A renderer or embedding is missing, broken, or its name is claimed by two distributions."""


class UnsupportedError(SvbrdfganError):
    """A renderer was asked for something that its capabilities do not declare."""


class TrainingError(SvbrdfganError):
    """Training cannot go on: a loss or weight is not finite, or a run does not fit its configuration."""
