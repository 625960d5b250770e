"""What names say of parts: whole words of several languages, not pieces of words, so that "Primary" is no rim."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass


def _split(text: str) -> list[str]:
    return text.split()


_WORDS = {
    "glass": "glass glas glazing window windows windshield windshields windscreen windscreens sunroof skylight vitre "
    "vitres verre verres parebrise fenetre scheibe scheiben fenster vidrio vidrios ventana ventanas parabrisas "
    "cristal "
    "cristales luneta vetro vetri finestrino finestrini parabrezza vidro vidros janela janelas parabrisa szyba szyby "
    "szklo steklo stekla stekl steklos okno okna lobovoe lobovuha quarterlight quarterlights visor visors",
    "tyre": "tyre tyres tire tires pneu pneus pneumatico pneumatici pneumatique reifen neumatico neumaticos "
    "opona opony shina shiny shina pokryshka pokryshki pokrishka bieznik protektor tread treads gomma gomme",
    "rubber": "rubber rubbers gummi rezina rezin caoutchouc goma borracha guma kautschuk caucho",
    "rim": "rim rims felge felgen jante jantes llanta llantas cerchio cerchi cerchione cerchioni felga felgi "
    "hubcap hubcaps spokes alloys radkappe radkappen tapacubos kolpak kolpaki brakedisc brakedisk bremsscheibe "
    "caliper "
    "calipers brakes brake lugnut lugnuts diska rotor rotors",
    "wheel": "wheel wheels rad raeder roue roues rueda ruedas ruota ruote roda rodas kolo kola koleso kolesa kolyosa",
    "chrome": "chrome chromed chrom cromo cromado cromato chromo hrom khrom krom chromowany crom",
    "lamp": "lamp lamps light lights lens lenses headlamp headlamps headlight headlights taillight taillights "
    "taillamp "
    "taillamps foglight foglights foglamp foglamps brakelight brakelights indicator indicators blinker blinkers "
    "blink "
    "turnsignal turnsignals drl led leds bulb bulbs reflector reflectors flasher flashers beacon beacons siren "
    "sirens "
    "strobe strobes licht lichter leuchte leuchten scheinwerfer ruecklicht rueckleuchte lampe lampen blinklicht "
    "feu feux "
    "phare phares lumiere clignotant clignotants luz luces faro faros piloto pilotos intermitente intermitentes luce "
    "luci fari fanale fanali freccia farol farois lanterna lanternas lampa lampy swiatlo swiatla reflektor "
    "reflektory "
    "fara fary far fonar fonari fonary svet povorotnik povorotniki optika tailight headligth lightbar",
    "mirror": "mirror mirrors spiegel retroviseur retro retrovisor retrovisores espejo espejos specchio specchi "
    "specchietto espelho espelhos lusterko lusterka zerkalo zerkala",
    "plate": "license licence licenseplate licenceplate numberplate plate kennzeichen nummernschild nummerschild "
    "immatriculation matricula targa placa rejestracja tablica nomer nomera gosnomer numplate regplate",
    "interior": "interior interiors cockpit dashboard dash seat seats steering steeringwheel seatbelt seatbelts "
    "upholstery pedal pedals gauge gauges speedometer headrest headrests armrest carpet driver drivers passenger "
    "passengers pilot dummy innenraum innen armaturenbrett lenkrad sitz sitze fahrer interieur habitacle siege "
    "sieges "
    "volant tableau conducteur asiento asientos volante salpicadero tablero conductor sedile sedili cruscotto "
    "abitacolo "
    "assento assentos banco bancos painel wnetrze fotel fotele kierownica kierowca salon sidenie sidenia sidenya rul "
    "torpeda torpedo voditel cabininterior insides",
    "ground": "ground shadow shadows floorplane groundplane boden schatten sol ombre suelo sombra terreno pavimento "
    "ombra chao podloga cien ten tenj zemlya pol backdrop",
    "decal": "decal decals sticker stickers logo logos emblem emblems badge badges aufkleber autocollant pegatina "
    "adesivo naklejka nakleyka",
    "paint": "paint paints carpaint painted paintjob lack autolack lackierung peinture pintura vernice lakier kraska "
    "body bodywork bodypaint carbody coachwork karosserie karosse carrosserie carroceria carrozzeria carrocaria "
    "karoseria "
    "nadwozie kuzov kuzova livery primary secondary hood bonnet door doors trunk boot fender fenders roof tailgate "
    "fuselage hull motorhaube tuer tueren dach kotfluegel capot porte portes toit coffre porta portas porte puerta "
    "puertas cofano tetto drzwi maska dach dver dveri kapot krysha bagazhnik krylo kabina cab",
    "trim": "trim plastic plastics bumper bumpers grille grill spoiler skirt skirts sill sills diffuser "
    "splitter molding "
    "moulding wiper wipers stossstange parechoc paraurti parachoque zderzak bamper reshetka",
    "chassis": "chassis frame undercarriage underbody axle axles suspension exhaust muffler engine motor "
    "bed cargo trailer tank bottom underside rahmen auspuff fahrgestell achse telaio chasis rama os vyhlop",
}
_WHEELS_WEAK = {"tier": "tyre", "tiers": "tyre", "tiere": "tyre", "trak": "tyre", "hub": "rim", "hubs": "rim"}
_KIND = {word: kind for kind, text in _WORDS.items() for word in text.split()}

KEPT = ("glass", "tyre", "rubber", "lamp", "rim", "wheel", "chrome", "mirror", "plate", "interior", "ground", "decal")
"""Kinds of parts that the words of a name keep, most telling first."""

WEATHERED = ("paint", "trim", "chassis")

_ENDS = {
    **dict.fromkeys(("glass", "glas", "window", "windows", "scheibe", "scheiben", "fenster", "steklo"), "glass"),
    **dict.fromkeys(("tire", "tires", "tyre", "tyres", "reifen"), "tyre"),
    **dict.fromkeys(("wheel", "wheels"), "wheel"),
    **dict.fromkeys(("felge", "felgen"), "rim"),
    **dict.fromkeys(("light", "lights", "lamp", "lamps", "licht", "lichter", "leuchte", "leuchten"), "lamp"),
    **dict.fromkeys(("spiegel", "mirror", "mirrors"), "mirror"),
    "chrome": "chrome",
}
"""Ends of compounds that are written as one word, such as "frontglass"."""

_NOT = frozenset(
    _split(
        "fiberglass fibreglass hourglass entire attire retire satire clamp clamps highlight highlights flight "
        "slight twilight "
        "daylight sunlight moonlight starlight delight lightweight flywheel"
    )
)
_HOLDERS = frozenset(
    _split(
        "frame frames housing housings trim arch arches archs well wells guard guards bezel surround surrounds bracket "
        "brackets mount mounts casing case seal seals fender fenders house box bay carrier holder rahmen gehaeuse edge "
        "border sill liner bucket post pillar rail rails"
    )
)
_COLOURS = frozenset(
    _split(
        "blue grey gray green red white black brown yellow orange purple pink beige wood metal steel paint color "
        "colour skin "
        "leather cyan dark tan gold silver aluminium aluminum plastic fabric stone"
    )
)
_PLATES = frozenset(_split("license licence number num reg registration nummer front rear back car"))


@dataclass(frozen=True)
class Telling:
    """What a name says: a kind, the word that says so, and whether that word often means something else."""

    kind: str
    word: str
    weak: bool = False


def split_words(name: str) -> tuple[str, ...]:
    """The words of a name in lower case, cut at signs, digits and camel case; accents are dropped."""
    name = name.translate({0xE4: "ae", 0xF6: "oe", 0xFC: "ue", 0xDF: "ss", 0xC4: "Ae", 0xD6: "Oe", 0xDC: "Ue"})
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    found = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", re.sub(r"[^A-Za-z]+", " ", plain))
    return tuple(word.lower() for word in found)


Shades = frozenset[tuple[str, ...]]
"""The words of names besides "dark"."""


def shades(names: Iterable[str]) -> Shades:
    """Of all names of a file, those that are a dark shade of something."""
    found = (split_words(name) for name in names)
    return frozenset(_without(words, "dark") for words in found if "dark" in words)


def telling(name: str, others: Shades = frozenset()) -> Telling | None:
    """What a name says of its part; None if nothing.

    Args:
        others: the file's shades. Next to "Main_Dark", "Main_Light" is a shade and no lamp.
    """
    words = split_words(name)
    said = [found for position in range(len(words)) if (found := _said(words, position)) is not None]
    if not said or _is_shade(words, others):
        said = [found for found in said if found.kind != "lamp"]
    kinds = {found.kind: found for found in reversed(said)}
    if "interior" in kinds and set(words) & {"steering", "driver"}:
        return kinds["interior"]
    kept = next((kinds[kind] for kind in KEPT if kind in kinds), None)
    if kept is not None and kept.weak and "paint" in kinds:
        kept = None
    return kept or next((kinds[kind] for kind in WEATHERED if kind in kinds), None)


def _said(words: tuple[str, ...], position: int) -> Telling | None:
    word, rest = words[position], words[position + 1 :]
    joined = words[position - 1] + word if position else word  # "wind_shield", "FiberGlass"
    kind = None if joined in _NOT else _KIND.get(joined) or _kind(word)
    if kind is None:
        return Telling(_WHEELS_WEAK[word], word, weak=True) if word in _WHEELS_WEAK else None
    if kind in ("glass", "lamp", "wheel", "mirror", "rim") and _HOLDERS.intersection(rest):
        return Telling("trim", next(holder for holder in rest if holder in _HOLDERS))
    if kind == "plate" and word in ("plate", "placa", "tablica", "targa"):
        return Telling(kind, word, weak=not _PLATES.intersection(words) and len(words) > 1)
    coloured = word in ("light", "lens") and bool(_COLOURS.intersection(words))
    return Telling(kind, word, weak=coloured or word in ("retro", "pol", "ten", "sol", "far", "pilot", "stop", "rad"))


def _kind(word: str) -> str | None:
    if word in _NOT:
        return None
    if word in _KIND:
        return _KIND[word]
    return next((kind for end, kind in _ENDS.items() if word.endswith(end) and len(word) > len(end) + 2), None)


def _is_shade(words: tuple[str, ...], others: Shades) -> bool:
    """Whether "light" is a brightness: the same name occurs with "dark" in its place."""
    return "light" in words and _without(words, "light") in others


def _without(words: tuple[str, ...], word: str) -> tuple[str, ...]:
    return tuple(each for each in words if each != word)
