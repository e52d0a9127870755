# bash completion of entroslip: commands, options, scenes, values of a scene
_entroslip_values() {
  "$1" template --reference 2>/dev/null |
    awk '/^## &/ { group = substr($2, 2) } /^\| `/ { gsub(/`/, "", $2); print group "%" $2 "=" }'
}

_entroslip() {
  local word=$2 previous=$3 commands='run check tradeoff replay estimate whatif template' command='' i
  COMPREPLY=()
  for ((i = 1; i < COMP_CWORD; i++)); do
    case ${COMP_WORDS[i]} in
      run | check | tradeoff | replay | estimate | whatif | template) command=${COMP_WORDS[i]} ;;
    esac
  done
  case $previous in
    --output)
      compopt -o filenames
      mapfile -t COMPREPLY < <(compgen -f -- "$word")
      return ;;
    --set)
      compopt -o nospace
      mapfile -t COMPREPLY < <(compgen -W "$(_entroslip_values "$1")" -- "$word")
      return ;;
    --case | --sample) return ;;
  esac
  if [[ $word == -* ]]; then
    local options='--help --version'
    case $command in
      run) options='--output --fresh --set --share --quiet --help' ;;
      tradeoff) options='--output --set --quiet --help' ;;
      check) options='--set --quiet --help' ;;
      replay) options='--output --set --quiet --case --sample --help' ;;
      estimate) options='--output --quiet --help' ;;
      whatif) options='--set --quiet --help' ;;
      template) options='--reference --help' ;;
    esac
    mapfile -t COMPREPLY < <(compgen -W "$options" -- "$word")
  elif [[ -z $command ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$commands" -- "$word")
  elif [[ $command == estimate ]]; then
    compopt -o filenames
    mapfile -t COMPREPLY < <(compgen -f -- "$word")
  elif [[ $command == whatif ]]; then
    compopt -o filenames
    mapfile -t COMPREPLY < <(compgen -f -X '!*.h5' -- "$word"; compgen -d -- "$word")
  elif [[ $command != template ]]; then
    compopt -o filenames
    mapfile -t COMPREPLY < <(compgen -f -X '!*.nml' -- "$word"; compgen -d -- "$word")
  fi
}
complete -F _entroslip entroslip
