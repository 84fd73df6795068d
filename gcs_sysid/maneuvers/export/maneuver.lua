-- @NAME@: @HOW@
-- Written by gcs-sysid for @AIRCRAFT@.
--
-- Adds a test input to what ArduPlane commands, on the outputs themselves.
-- Needs SCR_ENABLE = 1 and a switch with RCn_OPTION = 300 (Scripting1). Switch high: fly once,
-- at the share of full amplitude that GSID_SHARE holds (0.25 at first). Any other position, and
-- anything outside of the limits below, ends it at once: 60 ms later the autopilot has the outputs.
-- Aileron, elevator and rudder must be moved by these outputs in the aircraft file too.

local NAME = "@NAME@"
local STEP_MS = 20
local HOLD_MS = 60
local COUNT = @COUNT@
local WIDTH = 5
local ENTRY_AIRSPEED = @AIRSPEED@ -- m/s
local ENTRY_WINDOW = 0.1 -- of it
local ENTRY_BANK = math.rad(10)
local AIRSPEED_MIN, AIRSPEED_MAX = @AIRSPEED_MIN@, @AIRSPEED_MAX@ -- m/s
local LOAD_MIN, LOAD_MAX = @LOAD_MIN@, @LOAD_MAX@ -- g
local BANK_MAX = @BANK_MAX@ -- rad
local HEIGHT_MIN = @HEIGHT_MIN@ -- m above home
local MODES = { [5] = true, [6] = true, [7] = true, [10] = true, [12] = true } -- FBWA, FBWB, CRUISE, AUTO, LOITER
local SWITCH_OPTION = 300
local HIGH = 2
local GRAVITY = 9.80665

-- Output number (from 1) and what is added to its pulse [us], WIDTH characters a sample.
local OUTPUTS = {
@OUTPUTS@}

local TABLE_KEY = 91
assert(param:add_table(TABLE_KEY, "GSID_", 1), "GSID: no room for parameters")
assert(param:add_param(TABLE_KEY, 1, "SHARE", 0.25), "GSID: no room for GSID_SHARE")
local share_parameter = Parameter()
assert(share_parameter:init("GSID_SHARE"), "GSID: GSID_SHARE not found")

-- Functions whose scaled output is a range from 0 to 100 and not an angle of 45 degrees (in cdeg).
local RANGES = { [70] = 100, [73] = 100, [74] = 100 }

local function setting(output, what)
  return assert(param:get(string.format("SERVO%d_%s", output, what)), "GSID: no SERVO" .. output)
end

for _, output in ipairs(OUTPUTS) do
  output.kind = setting(output.number, "FUNCTION")
  output.low = setting(output.number, "MIN")
  output.high = setting(output.number, "MAX")
  output.middle = setting(output.number, "TRIM")
  output.sign = setting(output.number, "REVERSED") == 1 and -1 or 1
end

-- What the autopilot would send: its own pulse cannot be read while it is overridden.
local function commanded(output)
  local scaled = SRV_Channels:get_output_scaled(output.kind)
  local range = RANGES[output.kind]
  if range then
    local part = math.max(0, math.min(1, scaled / range))
    if output.sign < 0 then
      part = 1 - part
    end
    return output.low + part * (output.high - output.low)
  end
  local part = math.max(-1, math.min(1, output.sign * scaled / 4500))
  if part > 0 then
    return output.middle + part * (output.high - output.middle)
  end
  return output.middle + part * (output.middle - output.low)
end

local function sample(output, index)
  return tonumber(string.sub(output.samples, (index - 1) * WIDTH + 1, index * WIDTH))
end

-- Why it must not fly on; nil where it may.
local function trouble()
  if not arming:is_armed() then
    return "disarmed"
  end
  if not MODES[vehicle:get_mode()] then
    return "mode"
  end
  if not rc:has_valid_input() then
    return "no RC"
  end
  if vehicle:has_ekf_failsafed() then
    return "EKF"
  end
  local airspeed = ahrs:airspeed_estimate()
  if not airspeed then
    return "no airspeed"
  end
  if airspeed < AIRSPEED_MIN or airspeed > AIRSPEED_MAX then
    return string.format("airspeed %.1f", airspeed)
  end
  local bank = math.abs(ahrs:get_roll())
  if bank > BANK_MAX then
    return string.format("bank %.0f", math.deg(bank))
  end
  local height = -ahrs:get_relative_position_D_home()
  if height < HEIGHT_MIN then
    return string.format("height %.0f", height)
  end
  local load = -ahrs:get_accel():z() / GRAVITY
  if load < LOAD_MIN or load > LOAD_MAX then
    return string.format("load %.1f", load)
  end
  return nil
end

local function not_ready()
  local airspeed = ahrs:airspeed_estimate()
  if math.abs(airspeed - ENTRY_AIRSPEED) > ENTRY_WINDOW * ENTRY_AIRSPEED then
    return string.format("fly %.0f m/s first", ENTRY_AIRSPEED)
  end
  if math.abs(ahrs:get_roll()) > ENTRY_BANK then
    return "level the wings first"
  end
  return nil
end

local begun = nil -- ms, while it flies
local share = 0
local was_high = true -- a switch that is high at power-up starts nothing

local function stop(why, severity)
  begun = nil
  gcs:send_text(severity, "GSID " .. NAME .. ": " .. why)
end

local function start(now)
  local why = trouble() or not_ready()
  if why then
    gcs:send_text(4, "GSID " .. NAME .. " not flown: " .. why)
    return
  end
  share = math.max(0, math.min(1, share_parameter:get() or 0))
  begun = now
  gcs:send_text(5, string.format("GSID %s: flying at %.0f %%", NAME, 100 * share))
end

local function fly(now)
  local why = trouble()
  if why then
    stop("aborted, " .. why, 3)
    return
  end
  local index = math.floor((now - begun) / STEP_MS) + 1
  if index > COUNT then
    stop("done", 5)
    return
  end
  for _, output in ipairs(OUTPUTS) do
    local pulse = commanded(output) + share * sample(output, index)
    pulse = math.floor(math.max(output.low, math.min(output.high, pulse)) + 0.5)
    SRV_Channels:set_output_pwm_chan_timeout(output.number - 1, pulse, HOLD_MS)
  end
  logger:write("GSID", "T,Share", "ff", (now - begun) / 1000, share)
end

local function update()
  local now = millis():toint()
  local switch = rc:find_channel_for_option(SWITCH_OPTION)
  local high = switch ~= nil and switch:get_aux_switch_pos() == HIGH
  if begun and not high then
    stop("stopped by the switch", 4)
  elseif begun then
    fly(now)
  elseif high and not was_high then
    start(now)
  end
  was_high = high
  return update, STEP_MS
end

gcs:send_text(6, "GSID " .. NAME .. " loaded")
return update, 1000
