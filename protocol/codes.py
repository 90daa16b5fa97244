"""The codes of the texts that a drone publishes for the operator: problems, findings and notices.

Programs decide by the code, people read the words: the words of a text may change in any release, its code never does.
"""

from __future__ import annotations

from enum import StrEnum, unique


@unique
class Code(StrEnum):
    """The code of a text, on the wire in kebab case. A new release may add codes; a reader passes unknown codes on.

    ``when``: what has happened, ``action``: what the operator does about it, as the table of codes in the documentation says.
    """

    when: str
    action: str

    def __new__(cls, code: str, when: str, action: str) -> Code:
        """Return a member whose value is the ``code``."""
        member = str.__new__(cls, code)
        member._value_, member.when, member.action = code, when, action
        return member

    # Autopilot and vehicle
    TELEMETRY_MISSING = "telemetry-missing", "The agent has no new telemetry.", "Check the autopilot and its cable."
    AUTOPILOT_LINK_LOST = "autopilot-link-lost", "No heartbeat arrives.", "Check cable, address and power of the autopilot."
    AUTOPILOT_DATA_MISSING = (
        "autopilot-data-missing",
        "The autopilot does not send position, attitude or landed state.",
        "Wait for its filter; then check its streams.",
    )
    AUTOPILOT_SIGNED = "autopilot-signed", "The autopilot ignores unsigned messages.", "Remove its MAVLink signing key."
    AUTOPILOT_REFUSAL = "autopilot-refusal", "The autopilot refuses a request.", "Read its message; remove the cause."
    AUTOPILOT_MESSAGE = "autopilot-message", "The autopilot's own words, beside a problem.", "Read them with that problem."
    AUTOPILOT_PORT_OPEN = (
        "autopilot-port-open",
        "Other senders can reach the autopilot's port.",
        "Set `vehicle.source`, or close the port.",
    )
    PARAMETER_WRONG = "parameter-wrong", "A parameter of the autopilot is wrong.", "Set it as the text says."
    PARAMETERS_UNREAD = "parameters-unread", "The autopilot's parameters are being read.", "Wait some seconds."
    FAILSAFE = "failsafe", "The autopilot is in a failsafe.", "Leave the vehicle to it; the pilot stands by."
    NOT_READY_TO_ARM = "not-ready-to-arm", "The autopilot would not arm.", "Read its message; remove the cause."
    BATTERY_LOW = "battery-low", "The battery is below the mission's reserve.", "Change it; in flight keep the launch place free."
    BATTERY_UNKNOWN = (
        "battery-unknown",
        "The autopilot tells no battery level any more.",
        "Return, and check the battery's sensor.",
    )
    SATELLITES_LOST = "satellites-lost", "No satellites are received.", "The pilot stands by; see the card on lost positions."
    POSITION_DISPUTED = (
        "position-disputed",
        "Satellites and estimate disagree.",
        "The pilot stands by; see the card on lost positions.",
    )
    POSITION_CONFIRMING = "position-confirming", "The position is back, and is being confirmed.", "Wait some seconds."
    VISION_FEED = "vision-feed", "The vision system gives no usable poses.", "Check the system, its address and its clock."
    MANUAL_CONTROL = (
        "manual-control",
        "A pilot or a failsafe flies the vehicle.",
        "To give it back: `resume`, `return` or `land`.",
    )
    MODE_NOT_FOLLOWED = "mode-not-followed", "The autopilot stays out of offboard.", "Switch to Position, and land by hand."
    PLAN_NOT_FOLLOWED = "plan-not-followed", "The vehicle flies far from its plans.", "Return; check load, propellers and tuning."
    LANDING = "landing", "The drone lands, or has landed, by its own decision.", "Mark the place; read the reason."
    STILL_ARMED = "still-armed", "The vehicle has landed and is armed.", "Command `land` once more, or disarm it by hand."
    LANDING_NOT_BELIEVED = "landing-not-believed", "A vehicle in flight is reported as landed.", "The pilot lands it by hand."
    MOVED_AFTER_LANDING = "moved-after-landing", "The position moved after the landing.", "Do not trust it; restart the agent."

    # Launch place, position and clock
    ORIGIN_MISSING = "origin-missing", "The autopilot has no origin for its frame yet.", "Wait for a position fix."
    ORIGIN_MOVED = "origin-moved", "The autopilot has moved its origin in flight.", "Land."
    LAUNCH_UNMEASURED = "launch-unmeasured", "The launch place is being measured.", "Leave the vehicle at rest for some seconds."
    LAUNCH_UNKNOWN = (
        "launch-unknown",
        "The agent does not know the launch place.",
        "Land, disarm, and restart it at its launch place.",
    )
    FRAME_NOT_EXACT = (
        "frame-not-exact",
        "A frame that counts as exact has jumped.",
        "Return; set the localisation of the mission.",
    )
    HEADING_UNKNOWN = "heading-unknown", "The drone does not know its heading yet.", "Place it where another drone sees it."
    DISPLACED = "displaced", "The position jumped while the agent was down.", "Restart autopilot and agent at the launch place."
    LOCALISATION_JUMP = (
        "localisation-jump",
        "The localisation jumped without saying so.",
        "Watch the drone; return if it repeats.",
    )
    POSITION_DOUBTFUL = (
        "position-doubtful",
        "After a jump there is a second possible place.",
        "Watch the drone; the pilot stands by.",
    )
    POSITION_UNCERTAIN = "position-uncertain", "The own position is uncertain by metres.", "Watch the drone; return if it grows."
    POSITION_UNKNOWN = (
        "position-unknown",
        "The place in the mission frame is not known.",
        "Command `land` where the ground is free.",
    )
    FRAME_UNKNOWN = "frame-unknown", "The frame of a drone is not known yet.", "Wait until other drones have seen it."
    FRAME_CONTRADICTED = "frame-contradicted", "Measurements contradict a drone's position.", "Look at it; return if it is wrong."
    CLOCK_OFF = "clock-off", "The drone's clock differs from the others'.", "Check chrony on that computer."

    # Camera and sensors
    CAMERA_MISSING = "camera-missing", "No camera is configured.", "Set `detector.driver` in the drone file."
    CAMERA_DRIVER = "camera-driver", "The camera's driver reports a fault.", "Check cable, power and address of the camera."
    CAMERA_SILENT = "camera-silent", "The camera delivers nothing any more.", "Land that drone; restart the camera."
    CAMERA_BLIND = "camera-blind", "The camera sees no hit, not even background.", "Land that drone; check the bias voltage."
    CAMERA_REPEATS = "camera-repeats", "The camera repeats the same hits.", "Land that drone; restart the camera."
    CAMERA_NOISY = "camera-noisy", "Noisy pixels are masked.", "Fly on; calibrate it if there are many."
    CAMERA_DEAD_BLOCKS = "camera-dead-blocks", "Parts of the sensor see nothing.", "Its counts are low: calibrate the camera."
    CAMERA_GAIN = "camera-gain", "The energy scale has drifted, and is corrected.", "Fly on; calibrate it after the flight."
    DETECTOR_UNUSABLE = (
        "detector-unusable",
        "Readouts of a detector cannot be used.",
        "Read the reason; check detector and drone file.",
    )
    NUCLIDE_OTHER = "nuclide-other", "The spectrum is that of another nuclide.", "Upload a mission with this nuclide."
    LINES_UNKNOWN = (
        "lines-unknown",
        "The spectrum has lines of no candidate nuclide.",
        "Keep away; identify the nuclide by other means.",
    )
    CONES_TURNED = "cones-turned", "The cones of a drone are turned.", "Check compass, mount and `camera_rpy_deg`."
    SIGHTINGS_FEED = "sightings-feed", "The sensor that sees other drones fails.", "Check the sensor, its address and its clock."

    # Other drones, links and members
    NO_CONTACT = "no-contact", "A drone of the mission has no network link.", "Start it, check its address, or start without it."
    PEERS_LOST = "peers-lost", "Drones are not heard any more.", "See the card on drones that are not heard."
    NOT_HEARD = "not-heard", "Other drones do not hear this one.", "Check its antenna after the flight."
    TRAFFIC = "traffic", "Another drone flies past the launch place.", "Start again in a moment."
    MISSION_DIFFERS = "mission-differs", "Another drone has another mission.", "Upload the same mission to all."
    PROTOCOL_DIFFERS = "protocol-differs", "A drone speaks another version of the protocol.", "Give all the same radron."
    OWN_ID_IN_USE = "own-id-in-use", "Another agent sends under this drone's id.", "End that agent, or revoke the copied key."
    TWO_SOURCES = "two-sources", "Two senders publish poses under one id.", "End the second agent, or revoke the copied key."
    TWO_SESSIONS = (
        "two-sessions",
        "Two network sessions publish under one name.",
        "End the second agent, or revoke the copied key.",
    )
    FLOOD = "flood", "A member sends too many messages.", "Revoke it if it goes on."
    LOG_QUERIES = "log-queries", "A member asks for too much of the log.", "Revoke it if it goes on."
    NETWORK_CLOSED = (
        "network-closed",
        "The network session could not be opened.",
        "Read the reason; check `mesh` in the drone file.",
    )
    LINKS_INSECURE = "links-insecure", "Links are not encrypted.", "Issue certificates, unless on a bench."
    MESSAGES_UNSIGNED = (
        "messages-unsigned",
        "Messages arrived that their drone has not signed.",
        "Look for the sender; keep the records.",
    )
    ENTRIES_TOO_MANY = "entries-too-many", "A drone publishes more log entries than cameras measure.", "Revoke it if it goes on."
    ENTRIES_LATE = "entries-late", "The log entries of a drone come late.", "Check its link and clock; revoke it if it goes on."
    EXPOSURES_LEFT_OUT = (
        "exposures-left-out",
        "The exposures of a drone overlap or are too long.",
        "Land it; its key may be copied.",
    )
    MEASUREMENTS_LEFT_OUT = (
        "measurements-left-out",
        "The measurements of a drone do not fit two others'.",
        "Look at it; return if its position is wrong.",
    )
    ENTRIES_CONTRADICT = (
        "entries-contradict",
        "A drone has published two entries with one number.",
        "Land it; its key may be copied.",
    )
    MEMBER_REVOKED = "member-revoked", "An operator has revoked a member.", "Land a revoked drone by hand."
    SELF_REVOKED = "self-revoked", "This drone has been revoked, and returns.", "Expect it at its launch place."

    # Computer, files and software
    COMPUTER_SLOW = "computer-slow", "Setpoints were late.", "End other programs; return if it goes on."
    MEMORY_LOW = "memory-low", "Little memory is left.", "End other programs, or land soon."
    INTERNAL_ERROR = "internal-error", "A part of the agent has failed; the flight continues.", "Return; report the agent's log."
    RECORDS_LOST = "records-lost", "The flight record has gaps, or is missing.", "Check the disk before the next flight."
    STATE_NOT_SAVED = "state-not-saved", "A restarted agent would not rejoin the flight.", "Free space on the disk."
    STATE_UNREADABLE = "state-unreadable", "The saved state cannot be read.", "Move the file away."
    REVOCATIONS_NOT_SAVED = (
        "revocations-not-saved",
        "A restarted agent would not know the revocations.",
        "Free space on the disk.",
    )
    REVOCATIONS_UNREADABLE = (
        "revocations-unreadable",
        "The saved revocations cannot be read.",
        "Move the file away; revoke again.",
    )
    CERTIFICATE_INVALID = "certificate-invalid", "The certificate is not valid for a flight.", "Renew it, or set the clock."
    CERTIFICATE_EXPIRING = "certificate-expiring", "The certificate ends within a month.", "Renew it after the flight."
    UPLOAD_RUNNING = "upload-running", "The drone takes over an uploaded mission.", "Wait some seconds."
    UPLOAD_UNUSABLE = "upload-unusable", "The uploaded mission cannot be used.", "Upload it again."
    MISSION_UPLOADED = (
        "mission-uploaded",
        "The mission was uploaded, not read from the file.",
        "Check that it is the intended one.",
    )
    MISSION_FILE_CHANGED = (
        "mission-file-changed",
        "The mission file counts, not the upload.",
        "Upload the mission again if it is the one.",
    )
    UPDATE_FAILED = "update-failed", "The last update of the software was undone.", "Read the reason; update again."
    UPDATE_ON_TRIAL = "update-on-trial", "New software is on trial.", "Wait until it is confirmed."
    ESTIMATOR_STARTING = "estimator-starting", "The estimator's process is not ready yet.", "Wait some seconds."
    ESTIMATOR_RESTARTING = (
        "estimator-restarting",
        "The estimator's process has ended, and starts anew.",
        "Wait; return if it repeats.",
    )

    # Findings of a search
    SOURCE_OUTSIDE = "source-outside", "A source lies outside the fence.", "Fly again with an area there."
    NOTHING_FOUND = "nothing-found", "The search is over without a source.", "Read the activity that is excluded."
    MAPPED = "mapped", "The survey for a map is over.", "Read the map and its uncertainty."
